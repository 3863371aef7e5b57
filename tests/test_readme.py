"""What README says of the library is run as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from equigrasp.cli import main

README = Path(__file__).parent.parent / "README.md"


def test_the_loop_of_a_policy_in_the_environment_runs_to_the_episodes_end(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = README.read_text()
    (block,) = re.findall(r"As a library:\n\n```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    train = ["train", "--steps", "2", "--threads", "1", "--text-encoder", "hashing", "--data", str(data)]
    main([*train, "--out", "quickstart/run"])
    capsys.readouterr()
    names: dict = {"__name__": "block"}
    try:
        exec(block, names)
        lines = capsys.readouterr().out.splitlines()
        # n goals and n + 1 trials of n from 4 to 5
        assert 4 <= len(lines) <= 6
        assert all("Grasp(" in line for line in lines)
        assert names["env"].terminated or names["env"].truncated
    finally:
        names["env"].close()
