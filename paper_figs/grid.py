"""A table as data, and the same table as Markdown, LaTeX and CSV."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from equigrasp.success import Rate


@dataclass(frozen=True)
class Value:
    """A number in a table.

    Attributes:
        value: the number.
        interval: its 95% Wilson interval, where it is a share of independent trials.
        trials: of how many trials or scenes, or None.
        digits: after the point.
    """

    value: float
    interval: tuple[float, float] | None = None
    trials: int | None = None
    digits: int = 1

    @classmethod
    def of(cls, rate: Rate) -> Value:
        """A rate in percent, with its interval."""
        low, high = rate.interval
        return cls(100 * rate.value, (100 * low, 100 * high), rate.trials)

    def __str__(self) -> str:
        text = f"{self.value:.{self.digits}f}"
        if self.interval is None:
            return text
        low, high = self.interval
        return f"{text} [{low:.{self.digits}f}, {high:.{self.digits}f}]"


@dataclass(frozen=True)
class Row:
    """A row.

    Attributes:
        labels: what it is, a text for each of the grid's heads.
        values: a number for each column; None is blank.
        rivals: rows with the same rivals compare with each other; None compares with nobody.
    """

    labels: tuple[str, ...]
    values: tuple[Value | None, ...]
    rivals: Hashable = None


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes:
        title: what it shows.
        heads: names of the labels.
        columns: names of the numbers.
        rows: in order.
        notes: what a reader must know, a sentence each.
    """

    title: str
    heads: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    def best(self) -> set[tuple[int, int]]:
        """Places (row, column) of the highest number among rivals, as printed; nobody wins alone."""
        groups: dict[tuple[Hashable, int], list[tuple[float, int]]] = defaultdict(list)
        for index, row in enumerate(self.rows):
            for column, value in enumerate(row.values):
                if value is not None and row.rivals is not None:
                    groups[row.rivals, column].append((round(value.value, value.digits), index))
        won = set()
        for (_, column), numbers in groups.items():
            highest = max(number for number, _ in numbers)
            if len(numbers) > 1:
                won |= {(index, column) for number, index in numbers if number == highest}
        return won

    def markdown(self) -> str:
        """As Markdown, the best in bold."""
        best = self.best()
        lines = [f"### {self.title}", ""]
        lines.append("| " + " | ".join((*self.heads, *self.columns)) + " |")
        lines.append("|" + "---|" * (len(self.heads) + len(self.columns)))
        for index, row in enumerate(self.rows):
            texts = [
                "" if value is None else f"**{value}**" if (index, column) in best else str(value)
                for column, value in enumerate(row.values)
            ]
            lines.append("| " + " | ".join((*row.labels, *texts)) + " |")
        if self.notes:
            lines += ["", *(f"- {note}" for note in self.notes)]
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        r"""As LaTeX, for `\usepackage{booktabs}`, the best in bold."""
        best = self.best()
        width = len(self.heads) + len(self.columns)
        lines = [r"\begin{table}", r"\centering", rf"\caption{{{_escaped(self.title)}}}"]
        lines += [rf"\begin{{tabular}}{{{'l' * len(self.heads)}{'r' * len(self.columns)}}}", r"\toprule"]
        lines += [" & ".join(map(_escaped, (*self.heads, *self.columns))) + r" \\", r"\midrule"]
        for index, row in enumerate(self.rows):
            texts = [
                "" if value is None else rf"\textbf{{{value}}}" if (index, column) in best else str(value)
                for column, value in enumerate(row.values)
            ]
            lines.append(" & ".join((*map(_escaped, row.labels), *texts)) + r" \\")
        lines.append(r"\bottomrule")
        lines += [
            rf"\multicolumn{{{width}}}{{p{{\linewidth}}}}{{\footnotesize {_escaped(note)}}} \\" for note in self.notes
        ]
        return "\n".join([*lines, r"\end{tabular}", r"\end{table}"]) + "\n"


def as_csv(grids: Sequence[Grid]) -> str:
    """Tables as one CSV, a line for each row and column; blank where there is no number, or no such label."""
    heads = list(dict.fromkeys(head for grid in grids for head in grid.heads))
    buffer = io.StringIO()
    writer = csv.DictWriter(
        buffer, ["table", *heads, "column", "value", "low", "high", "trials"], restval="", lineterminator="\n"
    )
    writer.writeheader()
    for grid in grids:
        for row in grid.rows:
            for column, value in zip(grid.columns, row.values, strict=True):
                line: dict[str, object] = {"table": grid.title, **dict(zip(grid.heads, row.labels, strict=True))}
                line["column"] = column
                if value is not None:
                    low, high = value.interval or ("", "")
                    line |= {"value": value.value, "low": low, "high": high, "trials": value.trials}
                writer.writerow(line)
    return buffer.getvalue()


ESCAPES = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{each: "\\" + each for each in "&%$#_{}"},
}


def _escaped(text: str) -> str:
    return "".join(ESCAPES.get(each, each) for each in text)
