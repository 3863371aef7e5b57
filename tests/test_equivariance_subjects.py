"""What laws are aimed at: at which sizes a policy is looked at, what is a policy and what a kernel, what correlates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.correlation import correlate
from equigrasp.errors import InputError
from equigrasp.fields import gspaces
from equigrasp.models import MODELS, build
from equivariance_tests import LAWS, check_equivariance
from equivariance_tests.check import Report
from equivariance_tests.figures import draw
from equivariance_tests.kernel_laws import inside
from equivariance_tests.law import Case, Law, Measurement, both, cases
from equivariance_tests.mutation import as_markdown
from equivariance_tests.record import MEASURED, SIDE, shown_at
from equivariance_tests.scenes import lattice
from equivariance_tests.sound import kernel, policy
from equivariance_tests.subjects import SIDES, PolicySubject
from equivariance_tests.wrapping import policy_subject, subjects_of

QUARTER = "policy: quarter turn"


class Sees(nn.Module):
    """A policy that remembers what it was shown, and takes the sizes that it is told to."""

    embedding_size = 4

    def __init__(self, takes: Callable[[int, int], bool] = lambda rows, columns: True, stride: int = 2) -> None:
        super().__init__()
        self.takes, self.stride, self.seen = takes, stride, set()

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        rows, columns = observation.shape[2:]
        if not self.takes(rows, columns):
            raise RuntimeError("not so")
        self.seen.add((rows, columns))
        return nn.functional.avg_pool2d(observation.mean(dim=1, keepdim=True), self.stride).expand(-1, 36, -1, -1)


def statuses(report: Report) -> dict[str, str]:
    return {finding.law.name: finding.status for finding in report.findings}


# At which sizes


def test_a_policy_is_looked_at_where_a_coarse_grid_has_a_middle_and_where_it_has_none() -> None:
    module = Sees()
    report = check_equivariance(module)
    assert report.passed, report
    assert module.seen == {(64, 128), (128, 128), (128, 256), (160, 160), (160, 320)}


@pytest.mark.parametrize(
    ("takes", "stride"),
    [
        (lambda rows, columns: rows % 64 == 0, 2),
        (lambda rows, columns: columns < 320, 2),
        (lambda rows, columns: True, 32),
    ],
    ids=["multiples of 64", "no wide ones", "a stride that 160 pixels are no even multiple of"],
)
def test_a_policy_is_asked_at_sizes_that_it_takes(takes: Callable[[int, int], bool], stride: int) -> None:
    module = Sees(takes, stride)
    subject = policy_subject(module)
    module.seen.clear()
    for law in ("policy: quarter turn", "policy: whole bins", "policy: eq. 2, any turn"):
        LAWS[law].judge(subject)
    assert module.seen == {(128, 128), (128, 256)}


def test_each_law_of_a_policy_looks_at_both_sizes_by_default() -> None:
    """Else one of them would be measured by chance alone."""
    for law in LAWS.values():
        if law.subject is PolicySubject:
            assert {case.seed % len(SIDES) for case in cases(law.turns, law.count)} == {0, 1}, law.name


def test_what_is_recorded_is_measured_at_one_size() -> None:
    """So that it can be held against what was recorded before."""
    subjects = shown_at(subjects_of(build(replace(MODELS["leg-steerable"], text_encoder="hashing"), seed=0)), SIDE)
    assert {each.sides for each in subjects if isinstance(each, PolicySubject)} == {(128,)}
    assert len(subjects) == len(MEASURED) == 2


def test_pixels_inside_an_image_are_its_own() -> None:
    for shape in ((5, 5), (4, 6)):
        points = lattice(*shape)
        assert inside(points, shape).all()
        assert int(inside(lattice(9, 9), shape).sum()) == shape[0] * shape[1]
        assert int(inside(points, shape, 1).sum()) == (shape[0] - 2) * (shape[1] - 2)


# What is a policy, and what a kernel


class Typed(Sees):
    """escnn's modules declare types, whatever they are."""

    in_type = fields.FieldType(gspaces.rot2dOnR2(4), 4 * [gspaces.rot2dOnR2(4).trivial_repr])
    out_type = fields.FieldType(gspaces.rot2dOnR2(4), 36 * [gspaces.rot2dOnR2(4).trivial_repr])


class Short(Typed):
    """Scores of half of the table, from an image and words."""

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return super().forward(observation, embedding)[:, :, :1]


class Flat(nn.Module):
    """Kernels without pixels."""

    embedding_size, in_type, out_type = 4, fields.trivial_type(1), fields.even_type(2)

    def forward(self, embedding: Tensor, loudness: float = 1.0) -> Tensor:
        return loudness * embedding[:, None, None, :1]


def test_what_takes_an_image_and_an_embedding_is_a_policy_whatever_it_declares() -> None:
    (subject,) = subjects_of(Typed())
    assert isinstance(subject, PolicySubject)
    assert subject.declared == 4
    assert statuses(check_equivariance(Typed(), [QUARTER])) == {QUARTER: "holds"}
    with pytest.raises(InputError, match=r"makes \(1, 36, 1, 64\) of .*is taken for a policy, .* being two, an image"):
        subjects_of(Short())
    with pytest.raises(InputError, match=r"makes \(1, 1, 1, 1\); it has in_type .* is taken for a kernel, .* not two"):
        subjects_of(Flat())
    with pytest.raises(InputError, match=r"does not take \(1, 4\).*is taken for a kernel"):
        subjects_of(type("Odd", (Flat,), {"forward": lambda self, embedding: embedding.no_such_thing})())


# Policies that compute elsewhere


class InNumpy(Sees):
    """Under no_grad, as a robot asks, numpy may be used inside."""

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return super().forward(torch.from_numpy(observation.numpy().copy()), embedding)


class InPlace(nn.Module):
    """What a gradient would need is written over."""

    embedding_size = 4

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        scores = nn.functional.avg_pool2d(observation, 2).mean(dim=1, keepdim=True).sqrt()
        scores += 1
        return scores.expand(-1, 36, -1, -1)


@pytest.mark.parametrize("make", [InNumpy, InPlace])
def test_a_policy_that_has_no_gradients_to_give_is_measured(make: Callable[[], nn.Module]) -> None:
    laws = [QUARTER, "policy: eq. 2, quarter turns"]
    assert statuses(check_equivariance(make(), laws)) == dict.fromkeys(laws, "holds")


# What correlates


class Correlates(nn.Module):
    """A policy with a kernel, and something called correlate."""

    embedding_size = 4

    def __init__(self, correlation: Any) -> None:
        super().__init__()
        self.correlate = correlation
        self.kappa = Kappa()

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return observation.mean(dim=1, keepdim=True).expand(-1, 36, -1, -1) + 0 * embedding.sum()


class Kappa(nn.Module):
    """A Gaussian, which turns: louder or not, as the words say."""

    in_type, out_type = fields.trivial_type(1), fields.even_type(0)

    def forward(self, embedding: Tensor) -> Tensor:
        ring = torch.exp(-fields.grid(9).square().sum(dim=1) / 8).view(1, 1, 1, 9, 9)
        return embedding[:, :1, None, None, None] * ring.float()


def narrow(features: Tensor, kernels: Tensor) -> Tensor:
    return nn.functional.conv2d(features, kernels[0])


@pytest.mark.parametrize(
    ("correlation", "sentence"),
    [
        (True, "Kappa's policy has a `correlate` that is a bool; let it take features"),
        (
            lambda features, kernels, stride: features,
            r"does not take \(1, 1, 10, 12\) and \(1, 1, 1, 9, 9\) \(.*stride",
        ),
        (lambda features, kernels: features.repeat(1, 2, 1, 1), r"makes torch.float32 \(1, 2, 10, 12\) of"),
        (narrow, r"makes torch.float32 \(1, 1, 2, 4\) of .* to \(B, O, H, W\), zero beyond the border"),
        (lambda features, kernels: None, "makes NoneType of"),
    ],
    ids=["no function", "three arguments", "channels", "no padding", "nothing"],
)
def test_a_correlate_that_is_none_is_one_sentence(correlation: Any, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as error:
        check_equivariance(Correlates(correlation), ["correlation"])
    assert "\n" not in str(error.value)


def test_a_correlate_may_have_weights_and_what_it_takes_later_is_looked_at_as_well() -> None:
    weight = nn.Parameter(torch.ones(()))
    laws = ["correlation", "lemma 2", "eq. 2, any turn"]
    found = statuses(check_equivariance(Correlates(lambda each, kernels: weight * correlate(each, kernels)), laws))
    assert found["correlation"] == found["lemma 2"] == "holds"
    with pytest.raises(InputError, match=r"makes torch.float32 \(2, 1, 64, 65\) of \(2, 1, 65, 65\)"):
        check_equivariance(Correlates(lambda each, kernels: correlate(each, kernels)[:, :, :64]), ["correlation"])


# In how many cases


def silent_but_in(count: int) -> Law:
    """A law that can be measured in so many of 12 cases."""
    drawn = iter(range(12))

    def measure(subject: Any, case: Case) -> Measurement | None:
        return Measurement(0.5, "something") if next(drawn) < count else None

    return replace(LAWS["eq. 2, any turn"], measure=measure, count=12, tolerance=both(1.0))


def test_a_law_that_was_measured_in_few_cases_says_so() -> None:
    few, all_of_them = (silent_but_in(count).judge(kernel()) for count in (1, 12))
    assert "100% of cases within), in 1 of 12 cases, the others say nothing" in str(few)
    assert "say nothing" not in str(all_of_them)
    assert (few.to_dict()["cases"], few.to_dict()["drawn"]) == (1, 12)
    table = as_markdown({"quiet": {few.law: few}, "loud": {few.law: all_of_them}})
    assert "| quiet | 0.5 (1 of 12) |" in table
    assert "| loud | 0.5 |" in table


def test_ties_that_silence_a_law_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    coarse = replace(policy(scores=lambda scores: (scores / 4).round() * 4), reach=None)
    report = check_equivariance(coarse, ["policy: eq. 2, any turn"])
    (verdict,) = (finding.verdict for finding in report.findings)
    assert verdict is not None
    assert 0 < verdict.cases < verdict.drawn == LAWS["policy: eq. 2, any turn"].count
    assert f"in {verdict.cases} of {verdict.drawn} cases, the others say nothing" in str(report)
    written = []
    monkeypatch.setattr("matplotlib.axes.Axes.annotate", lambda self, text, *rest, **more: written.append(text))
    draw(report, {}, {report.name: [0.1]}, tmp_path / "report.png")
    assert any(text.endswith(f", {verdict.cases} of {verdict.drawn} cases") for text in written), written
