"""Lines that were put together from several machines: of a cell's lines the latest counts, in whichever order."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from equigrasp.study.results import known_by, read, recover

CELL = {"kind": "grasp", "model": "m", "seed": 0}


def written(path: Path, lines: list[dict[str, Any]]) -> Path:
    path.write_text("".join(json.dumps(line, sort_keys=True) + "\n" for line in lines))
    return path


def test_the_latest_of_a_cells_lines_counts_and_is_the_one_that_is_kept(tmp_path: Path) -> None:
    dates = ("2026-11-01T00:00:00+00:00", "2026-11-20T00:00:00+00:00", "2026-11-03T00:00:00+00:00")
    lines = [{**CELL, "date": date, "paper": {"reward": place}} for place, date in enumerate(dates)]
    undated = {**CELL, "paper": {"reward": 9}}
    for order in itertools.permutations([*lines, undated]):
        path = written(tmp_path / "results.jsonl", list(order))
        assert read(path)[0] == recover(path)[0] == [lines[1]]
        assert path.read_text().splitlines() == [json.dumps(lines[1], sort_keys=True)]


def test_what_an_editor_puts_first_spoils_no_line(tmp_path: Path) -> None:
    path = written(tmp_path / "results.jsonl", [CELL])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert read(path) == ([CELL], "")


def test_results_behind_a_link_are_mended_where_they_lie(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    there = written(tmp_path / "far" / "results.jsonl", [CELL, CELL])
    (tmp_path / "results.jsonl").symlink_to(there)
    assert recover(tmp_path / "results.jsonl")[0] == [CELL]
    assert (tmp_path / "results.jsonl").is_symlink()
    assert there.read_text().count("\n") == 1


@given(st.permutations(["x", "y", "z"]), st.permutations(["x", "y", "z"]))
def test_of_one_date_the_same_line_counts_in_every_order(one: list[str], other: list[str]) -> None:
    with TemporaryDirectory() as folder:
        found = [
            read(written(Path(folder) / "lines", [{**CELL, "date": "d", "paper": each} for each in order]))[0]
            for order in (one, other)
        ]
    assert found[0] == found[1]
    assert len(found[0]) == 1


def test_cells_keep_their_places_and_none_is_doubled(tmp_path: Path) -> None:
    cells = [{**CELL, "seed": seed, "date": "a"} for seed in range(3)]
    path = written(tmp_path / "results.jsonl", [*cells, {**cells[1], "date": "b"}, {**cells[0], "date": "0"}])
    expected = [cells[0], {**cells[1], "date": "b"}, cells[2]]
    assert recover(path)[0] == expected
    before = path.read_bytes()
    assert recover(path)[0] == expected
    assert path.read_bytes() == before
    assert len({known_by(line) for line in expected}) == 3
