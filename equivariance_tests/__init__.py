"""Laws of symmetry for any grasp kernel or policy, ours or yours; each verdict comes with its measured error.

In a test of yours:

    from equivariance_tests import check_equivariance

    def test_my_kernel_turns():
        report = check_equivariance(MyKernel())
        assert report.passed, report

Or from the command line: `pytest --pyargs equivariance_tests --equigrasp-policy my_package.my_module:make`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from equivariance_tests.check import Report, check_equivariance
    from equivariance_tests.laws import LAWS

__all__ = ["LAWS", "Report", "check_equivariance"]


def __getattr__(name: str) -> Any:
    """Import on use: pytest loads the plugin beside this file in every run, which must not cost torch."""
    if name == "LAWS":
        from equivariance_tests.laws import LAWS

        return LAWS
    if name in __all__:
        from equivariance_tests import check

        return getattr(check, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
