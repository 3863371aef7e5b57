"""A table as data, and the same table as Markdown, LaTeX and CSV."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from equigrasp.success import MeanReward, Rate


@dataclass(frozen=True)
class Value:
    """A number in a table.

    Attributes:
        value: the number.
        interval: its 95% Wilson interval, where it is a share of trials or a mean over scenes.
        trials: of how many trials or scenes, or None.
        digits: after the point.
    """

    value: float
    interval: tuple[float, float] | None = None
    trials: int | None = None
    digits: int = 1

    @classmethod
    def of(cls, measured: Rate | MeanReward) -> Value:
        """A rate or a mean reward in percent, with its interval."""
        low, high = measured.interval
        count = measured.trials if isinstance(measured, Rate) else measured.scenes
        return cls(100 * measured.value, (100 * low, 100 * high), count)

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
        r"""As LaTeX that fits the page and goes on over pages, the best in bold; `PACKAGES` says what it needs.

        A label that every row has is said in the caption; heads stand upright but for the first, and a table wider than
        a page lies on its side.
        """
        told = [
            index
            for index, head in enumerate(self.heads)
            if index and len(self.rows) > 1 and len({row.labels[index] for row in self.rows}) == 1
        ]
        kept = [index for index in range(len(self.heads)) if index not in told]
        common = "".join(f"; {self.heads[index]}: {self.rows[0].labels[index]}" for index in told)
        widths = [max((len(row.labels[index]) for row in self.rows), default=0) for index in kept]
        shape = "".join(WRAPPED if width > LONG else "l" for width in widths) + "r" * len(self.columns)
        names = [_escaped(self.heads[kept[0]]), *(self.heads[index] for index in kept[1:]), *self.columns]
        head = " & ".join([names[0], *(rf"\rotatebox{{90}}{{{_escaped(name)}}}" for name in names[1:])]) + r" \\"
        best = self.best()
        body = []
        for index, row in enumerate(self.rows):
            texts = [
                "" if value is None else _in_latex(value, (index, column) in best)
                for column, value in enumerate(row.values)
            ]
            body.append(" & ".join((*(_escaped(row.labels[each]) for each in kept), *texts)) + r" \\")
        lines = [
            r"\scriptsize\setlength{\tabcolsep}{3pt}\setlength{\LTcapwidth}{\linewidth}",
            rf"\begin{{longtable}}{{{shape}}}",
            rf"\caption{{{_escaped(self.title + common)}}} \\",
            r"\toprule",
            head,
            r"\midrule",
            r"\endhead",
            r"\bottomrule",
            r"\endlastfoot",
            *body,
            r"\end{longtable}",
            *(rf"\noindent {_escaped(note)}\par" for note in self.notes),
        ]
        numbers = [
            max((len(str(row.values[column] or "")) for row in self.rows), default=0)
            for column in range(len(self.columns))
        ]
        characters = sum(min(width, LONG) for width in widths) + sum(numbers)
        around = "landscape" if characters + 2 * (len(widths) + len(numbers)) > PAGE else "center"
        return "\n".join([rf"\begin{{{around}}}", *lines, rf"\end{{{around}}}"]) + "\n"


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


PACKAGES = ("array", "booktabs", "graphicx", "longtable", "pdflscape")
"""What the LaTeX tables need, by `\\usepackage`; all come with TeX Live."""

LONG = 24
"""Labels of more characters are broken over lines."""

PAGE = 125
"""Characters in `\\scriptsize` across a page with margins of an inch; a gap between columns is two."""

WRAPPED = r">{\raggedright\arraybackslash}p{24mm}"

ESCAPES = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{each: "\\" + each for each in "&%$#_{}"},
}


def _escaped(text: str) -> str:
    return "".join(ESCAPES.get(each, each) for each in text)


def _in_latex(value: Value, best: bool) -> str:
    number, _, interval = str(value).partition(" ")
    return (rf"\textbf{{{number}}}" if best else number) + (rf" {{\tiny {interval}}}" if interval else "")
