"""The pytest plugin: the laws aimed at a policy or kernel of your own.

    pytest --pyargs equivariance_tests --equigrasp-policy my_package.my_module:make

`make()` gives a kernel or a policy as `subjects.py` describes them; with it, the tests of this package are about that
module instead of the project's own, with the same examples every time; tests of yours that run beside them are left
alone. `--equigrasp-expect LAW=REASON`, as often as needed, names a law that it is known to break.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equivariance_tests.subjects import KernelSubject, PolicySubject

OPTION = "--equigrasp-policy"
EXPECT = "--equigrasp-expect"
HERE = Path(__file__).resolve().parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("equigrasp", "laws of symmetry")
    group.addoption(OPTION, metavar="PKG:MAKE", help="aim the laws at what my_package.my_module:make gives")
    group.addoption(EXPECT, metavar="LAW=REASON", action="append", default=[], help="a law that it is known to break")


def pytest_configure(config: pytest.Config) -> None:
    """Load the module at once: a mistake in its name is one sentence, not a traceback for each test."""
    name, excuses = config.getoption(OPTION, None), config.getoption(EXPECT, [])
    config.stash[_EXPECTED], config.stash[_SUBJECTS] = {}, []
    if name is None and not excuses:
        return
    try:
        config.stash[_EXPECTED] = dict(_excuse(each) for each in excuses)
        if name is None:
            raise InputError(f"{EXPECT} is about a module of yours; name it with {OPTION}")
        from equivariance_tests.laws import LAWS
        from equivariance_tests.wrapping import load_by_name, subjects_of

        aimed = config.stash[_SUBJECTS] = list(subjects_of(load_by_name(name)))
        for law in config.stash[_EXPECTED]:
            if not any(isinstance(each, LAWS[law].subject) and LAWS[law].applies(each) is None for each in aimed):
                raise InputError(f"the law {law!r} says nothing about {name}; leave its {EXPECT} out")
    except InputError as error:
        raise pytest.UsageError(str(error)) from None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With the option, leave out those tests of this package that are about the project's own modules."""
    if not subjects(config):
        return
    left_out = [item for item in items if HERE in item.path.resolve().parents and not _aimed(item)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]


_EXPECTED: pytest.StashKey[dict[str, str]] = pytest.StashKey()
_SUBJECTS: pytest.StashKey[list[Any]] = pytest.StashKey()


def subjects(config: pytest.Config) -> list[KernelSubject | PolicySubject]:
    """What the option named, as subjects; empty without it."""
    return config.stash.get(_SUBJECTS, [])


def expected_failures(config: pytest.Config) -> dict[str, str]:
    """Law -> reason, as the options said."""
    return config.stash.get(_EXPECTED, {})


def _aimed(item: pytest.Item) -> bool:
    return bool({"aimed", "aimed_together"} & set(getattr(item, "fixturenames", ())))


def _excuse(text: str) -> tuple[str, str]:
    from equigrasp.errors import unknown
    from equivariance_tests.laws import LAWS

    law, _, reason = (part.strip() for part in text.partition("="))
    if not reason:
        raise InputError(f"{EXPECT} is LAW=REASON, but this is {text!r}; say why the law is known to be broken")
    if law not in LAWS:
        raise unknown("law", law, LAWS)
    return law, reason
