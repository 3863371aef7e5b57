"""`check_equivariance` and the pytest plugin on modules from outside the package: verdicts, excuses, mistakes."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.errors import InputError
from equigrasp.kernel import SteerableKernel
from equigrasp.policy import LegPolicy
from equivariance_tests import LAWS, check_equivariance
from equivariance_tests.check import Report
from equivariance_tests.comparison import error_against_angle, errors_of_eq_2
from equivariance_tests.mutants import wrapped
from equivariance_tests.subjects import turns_as_waves
from equivariance_tests.test_laws import CellMeans
from equivariance_tests.wrapping import kernel_subject, load_by_name, subjects_of

SOURCE = Path(__file__).parent.parent / "docs" / "my_kernel.py"


def outside() -> Any:
    """The documentation's example, a module that no package knows."""
    spec = importlib.util.spec_from_file_location("my_kernel", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


my_kernel = outside()
RingKernel, make, make_broken = my_kernel.RingKernel, my_kernel.make, my_kernel.make_broken
ABOUT_KERNELS = [law.name for law in LAWS.values() if law.subject.__name__ == "KernelSubject"]


def seeded(kernel: nn.Module) -> nn.Module:
    with torch.no_grad():
        for parameter in kernel.parameters():
            parameter.normal_(generator=torch.Generator().manual_seed(0))
    return kernel


class Says(nn.Module):
    """A kernel that makes whatever it is told to."""

    embedding_size = 4
    in_type, out_type = fields.trivial_type(1), fields.even_type(2)

    def __init__(self, kernel: Tensor) -> None:
        super().__init__()
        self.kernel = kernel

    def forward(self, embedding: Tensor) -> Tensor:
        return self.kernel


def statuses(report: Report) -> dict[str, str]:
    return {finding.law.name: finding.status for finding in report.findings}


def test_a_kernel_from_outside_passes_every_law() -> None:
    report = check_equivariance(seeded(make()))
    assert report.passed, report
    assert [finding.law.name for finding in report.findings] == ABOUT_KERNELS
    assert f"RingKernel: {len(ABOUT_KERNELS)} of {len(ABOUT_KERNELS)} laws" in str(report)


def test_its_broken_twin_fails_where_signs_can_be_seen() -> None:
    found = statuses(check_equivariance(seeded(make_broken())))
    broken = {"steerability", "steerability, wide band", "equivariance", "eq. 2, whole bins", "eq. 2, any turn"}
    assert {law for law, status in found.items() if status == "fails"} == broken
    assert found["lemma 1"] == "holds", "even frequencies hide a wrong sign at quarter turns"


def test_the_message_says_what_moved_where() -> None:
    report = check_equivariance(seeded(make_broken()), ["eq. 2, any turn"])
    assert "should have gone to Grasp(u=" in str(report)
    assert "a turn by" in str(report)


def test_an_expected_failure_is_none_and_an_unexpected_pass_is_one() -> None:
    laws = ["lemma 1", "steerability"]
    excused = check_equivariance(seeded(make_broken()), laws, {"steerability": "its sign is wrong"})
    assert excused.passed
    assert statuses(excused) == {"lemma 1": "holds", "steerability": "fails as expected"}
    assert "its sign is wrong" in str(excused)
    outlived = check_equivariance(seeded(make()), laws, {"steerability": "its sign was wrong"})
    assert not outlived.passed
    assert statuses(outlived)["steerability"] == "holds unexpectedly"


def test_a_law_that_says_nothing_says_why() -> None:
    class Odd(RingKernel):
        out_type = fields.FieldType(fields.gspace(), [fields.gspace().irrep(m) for m in (0, 1, 3, 5)])

    found = check_equivariance(seeded(Odd()), ["mirror", "eq. 2, any turn"])
    assert statuses(found) == {"mirror": "fails", "eq. 2, any turn": "says nothing"}
    assert "has no read_out" in str(found)


def test_where_every_law_is_silent_nothing_is_shown() -> None:
    class Odd(RingKernel):
        out_type = fields.FieldType(fields.gspace(), [fields.gspace().irrep(m) for m in (0, 1, 3, 5)])

    silent = check_equivariance(seeded(Odd()), ["eq. 2, any turn"])
    assert not silent.passed
    assert "0 of 0 laws as they should be, 1 more say nothing" in str(silent)
    with pytest.raises(InputError, match=r"'eq\. 2, any turn' says nothing about Odd"):
        check_equivariance(seeded(Odd()), ["mirror", "eq. 2, any turn"], {"eq. 2, any turn": "it has no bins"})


def test_a_discrete_group_is_asked_about_its_own_turns() -> None:
    class Eighths(RingKernel):
        in_type = fields.FieldType(fields.gspaces.rot2dOnR2(8), 3 * [fields.gspaces.rot2dOnR2(8).trivial_repr])
        out_type = fields.FieldType(fields.gspaces.rot2dOnR2(8), [fields.gspaces.rot2dOnR2(8).irrep(m) for m in (0, 2)])

        def forward(self, embedding: Tensor) -> Tensor:
            return super().forward(embedding)[:, :3]

    laws = ["lemma 1", "steerability", "equivariance"]
    found = statuses(check_equivariance(seeded(Eighths()), laws))
    assert found == dict.fromkeys(laws, "holds")
    clockwise = statuses(check_equivariance(seeded(Eighths(sign=-1)), laws))
    assert clockwise == {"lemma 1": "holds", "steerability": "fails", "equivariance": "fails"}


C4, FLIPS = fields.gspaces.rot2dOnR2(4), fields.gspaces.flip2dOnR2()


def trivial(space: fields.gspaces.GSpace2D, count: int) -> fields.FieldType:
    return fields.FieldType(space, count * [space.trivial_repr])


def test_types_over_different_groups_are_refused() -> None:
    """No turn is said of both: noise would pass."""

    class Mixed(RingKernel):
        in_type = trivial(fields.gspaces.rot2dOnR2(1), 3)

        def forward(self, embedding: Tensor) -> Tensor:
            noise = torch.randn(7, 3, 25, 25, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
            return embedding[:, :1, None, None, None] * noise

    with pytest.raises(InputError, match=r"Mixed has .* over different groups, C1 and SO\(2\), .* make one FieldType"):
        check_equivariance(Mixed())


def test_flips_are_no_turns_whatever_their_group_is_called() -> None:
    class Flipped(RingKernel):
        in_type, out_type = trivial(FLIPS, 3), trivial(FLIPS, 7)

    assert FLIPS.fibergroup.name == "C2"
    with pytest.raises(InputError, match=r"Flipped has the group C2 as .* turns of the plane alone"):
        check_equivariance(seeded(Flipped()))


def test_what_has_no_turn_has_shown_nothing() -> None:
    class Still(RingKernel):
        in_type, out_type = (trivial(fields.gspaces.rot2dOnR2(1), count) for count in (3, 7))
        read_out = fields.synthesis(6)

    others = ["fourier", "correlation", "translation", "lemma 2"]
    report = check_equivariance(seeded(Still()), [*others, "lemma 1", "steerability"])
    assert statuses(report) == dict.fromkeys(others, "holds") | dict.fromkeys(
        ["lemma 1", "steerability"], "says nothing"
    )
    assert not report.passed
    assert "no law about turns could be measured: Still: no case of it could be measured, its group" in str(report)
    assert check_equivariance(seeded(Still()), others).passed, "who leaves them out has not asked"


def sixths() -> nn.Module:
    """C_6 has half a turn, and no quarter."""
    space = fields.gspaces.rot2dOnR2(6)

    class Sixths(RingKernel):
        in_type = trivial(space, 3)
        out_type = fields.FieldType(space, [space.irrep(m) for m in (0, 2)])
        read_out = fields.synthesis(2, 9)

        def forward(self, embedding: Tensor) -> Tensor:
            return super().forward(embedding)[:, :3]

    return seeded(Sixths())


def test_turns_are_those_of_the_group_and_of_its_bins_whatever_is_drawn() -> None:
    kernel = sixths()
    report = check_equivariance(kernel)
    assert report.passed, report
    drawn = {finding.law.name: finding.law.count for finding in report.findings}
    measured = {each.law.name: each.verdict.cases for each in report.findings if each.verdict is not None}
    assert measured == drawn, "no case is lost to a turn that it has not"


def test_what_is_compared_is_asked_about_its_own_turns() -> None:
    class Still(RingKernel):
        in_type, out_type = (trivial(fields.gspaces.rot2dOnR2(1), count) for count in (3, 7))
        read_out = fields.synthesis(6)

    kernels = {each.name: each for each in (kernel_subject(sixths()), kernel_subject(seeded(Still())))}
    found = errors_of_eq_2(kernels, scenes=2)
    assert [len(errors) for errors in found["Sixths"].values()] == [2, 2]
    assert [len(errors) for errors in found["Still"].values()] == [0, 0]
    assert set(error_against_angle(kernels, draws=1)) == {"Sixths", "Still"}


def test_the_correlation_that_is_measured_is_the_policys_own() -> None:
    policy = LegPolicy(CellMeans(), SteerableKernel(512, 8, 17, 4), "hashing", "float32")
    laws = ["correlation", "translation"]
    assert statuses(check_equivariance(policy, laws)) == dict.fromkeys(laws, "holds")
    policy.correlation = wrapped
    assert statuses(check_equivariance(policy, laws))["correlation"] == "fails"


def test_chance_that_is_not_in_the_input_is_refused() -> None:
    class Noisy(RingKernel):
        def forward(self, embedding: Tensor) -> Tensor:
            return super().forward(nn.functional.dropout(embedding, 0.5, training=True))

    with pytest.raises(InputError, match="gives another answer when it is asked the same again"):
        check_equivariance(seeded(Noisy()))


def test_a_module_is_left_as_it_was() -> None:
    class Normed(RingKernel):
        def __init__(self) -> None:
            super().__init__()
            self.norm = nn.BatchNorm1d(16, dtype=torch.float64).eval()

        def forward(self, embedding: Tensor) -> Tensor:
            return super().forward(self.norm(embedding))

    module = Normed().train()
    module.norm.eval()
    check_equivariance(module, ["mirror"])
    assert module.training
    assert not module.norm.training, "batch norm that was frozen stays frozen"


@pytest.mark.parametrize("bins", [8, 18, 72])
def test_bins_may_be_of_any_number(bins: int) -> None:
    class Other(RingKernel):
        read_out = fields.synthesis(6, bins)

    report = check_equivariance(seeded(Other()), ["fourier", "bins turn"])
    assert report.passed, report


def test_a_read_out_is_asked_for_what_its_type_says() -> None:
    """Waves in another order with a read-out to match, and bins that are scores as they are, are both sound."""
    order = [1, 2, 0, 5, 6, 3, 4]

    class Reordered(RingKernel):
        out_type = fields.FieldType(fields.gspace(), [fields.gspace().irrep(m) for m in (2, 0, 6, 4)])
        read_out = fields.synthesis(6)[:, order]

        def forward(self, embedding: Tensor) -> Tensor:
            return super().forward(embedding)[:, order]

    class Bins(RingKernel):
        in_type = fields.FieldType(fields.gspaces.rot2dOnR2(72), 3 * [fields.gspaces.rot2dOnR2(72).trivial_repr])
        out_type = fields.FieldType(fields.gspaces.rot2dOnR2(72), [fields.gspaces.rot2dOnR2(72).quotient_repr(2)])
        read_out = torch.eye(36, dtype=torch.float64)

        def forward(self, embedding: Tensor) -> Tensor:
            return torch.einsum("io,bocvu->bicvu", fields.synthesis(6), super().forward(embedding))

    assert all(turns_as_waves(fields.even_type(frequency)) for frequency in (0, 2, 16))
    laws = ["fourier", "bins turn", "lemma 1", "eq. 2, whole bins"]
    expected = {"fourier": "says nothing"} | dict.fromkeys(laws[1:], "holds")
    for kernel in (Reordered(), Bins()):
        report = check_equivariance(seeded(kernel), laws)
        assert statuses(report) == expected, report
        assert "not a constant and then the waves of 2, 4, .. in this order" in str(report)
    wrong = seeded(Reordered())
    wrong.read_out = fields.synthesis(6)
    assert statuses(check_equivariance(wrong, laws))["bins turn"] == "fails"


def test_a_policy_without_a_gradient_is_measured() -> None:
    class Threshold(nn.Module):
        embedding_size = 16

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            bright = (observation[:, :1] > 130).to(observation) + 0 * embedding.sum()
            return bright.repeat(1, 36, 1, 1)

    assert statuses(check_equivariance(Threshold(), ["policy: quarter turn", "policy: eq. 2, any turn"]))


def test_a_check_draws_the_same_cases_for_a_seed() -> None:
    first, again, other = (check_equivariance(seeded(make()), ["steerability"], seed=s).to_dict() for s in (0, 0, 1))
    assert first == again != other


def test_a_policys_kernel_is_checked_with_it() -> None:
    class Policy(nn.Module):
        embedding_size = 16

        def __init__(self) -> None:
            super().__init__()
            self.kappa = seeded(make())

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            preferred = torch.linspace(1, 2, 36).view(1, 36, 1, 1)  # one angle of the table, whatever lies there
            return observation.mean(dim=1, keepdim=True) * preferred + 0 * embedding.sum()

    assert [type(each).__name__ for each in subjects_of(Policy())] == ["PolicySubject", "KernelSubject"]
    found = statuses(check_equivariance(Policy(), ["lemma 1", "policy: eq. 2, any turn"]))
    assert found == {"lemma 1": "holds", "policy: eq. 2, any turn": "fails"}


def test_a_policy_may_squeeze_the_words_before_its_kernel_hears_them() -> None:
    class Squeezes(nn.Module):
        embedding_size = 32

        def __init__(self) -> None:
            super().__init__()
            self.kappa = seeded(make())

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            loudness = self.kappa(embedding.double()[:, ::2]).abs().mean(dim=(1, 2, 3, 4)).view(-1, 1, 1, 1)
            return (observation.mean(dim=1, keepdim=True) * loudness).expand(-1, 36, -1, -1).float()

    assert [each.embedding_size for each in subjects_of(Squeezes())] == [32, 16]
    assert statuses(check_equivariance(Squeezes(), ["lemma 1"])) == {"lemma 1": "holds"}


class Answers(nn.Module):
    """A policy that answers whatever it is told to."""

    embedding_size = 4

    def __init__(self, answer: Callable[[Tensor], Tensor]) -> None:
        super().__init__()
        self.answer = answer

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return self.answer(observation)


def pooled(observation: Tensor) -> Tensor:
    """36 scores of a cell of 2 x 2 pixels, each the same: its mean."""
    return nn.functional.avg_pool2d(observation.mean(dim=1, keepdim=True), 2).expand(-1, 36, -1, -1)


FIELDS = ["policy: quarter turn", "policy: whole bins", "policy: translation", "policy: eq. 2, quarter turns"]


def test_scenes_are_what_a_camera_could_see() -> None:
    seen = []

    def watch(observation: Tensor) -> Tensor:
        seen.append((observation[:, :3].min(), observation[:, :3].max(), observation[:, 3].min()))
        return pooled(observation)

    class Sees(Answers):
        reach = 0.5

    assert check_equivariance(Sees(watch)).passed
    darkest, brightest, lowest = (torch.stack(each) for each in zip(*seen, strict=True))
    assert 0 <= darkest.min() < 60, "and the range is used"
    assert 200 < brightest.max() <= 255
    assert lowest.min() == 0


def test_what_a_policy_forbids_is_no_mistake() -> None:
    """Minus infinity, as `GraspPolicy.act` has it; a policy that forbids by the place does not turn."""

    def at_the_border(observation: Tensor) -> Tensor:
        return nn.functional.pad(pooled(observation)[..., 2:-2, 2:-2], (2, 2, 2, 2), value=-torch.inf)

    def on_the_bare_table(observation: Tensor) -> Tensor:
        height = nn.functional.avg_pool2d(observation[:, 3:], 2)
        return pooled(observation).masked_fill(height < 1e-4, -torch.inf)

    def to_the_right(observation: Tensor) -> Tensor:
        scores = pooled(observation).clone()
        scores[..., 40:] = -torch.inf
        return scores

    for answer in (at_the_border, on_the_bare_table):
        report = check_equivariance(Answers(answer), FIELDS)
        assert report.passed, report
    found = check_equivariance(Answers(to_the_right), ["policy: quarter turn"])
    assert "where its turned twin is allowed" in str(found)


def test_where_cells_tie_the_best_grasp_says_nothing_and_scores_that_are_all_one_have_not_passed() -> None:
    flat = check_equivariance(Answers(lambda seen: pooled(seen).clamp(max=90.0)), FIELDS)
    assert flat.passed, flat
    assert statuses(flat)["policy: eq. 2, quarter turns"] == "says nothing"
    assert "the best grasp being at several cells at once" in str(flat)
    constant = check_equivariance(Answers(lambda seen: 0 * pooled(seen)))
    assert not constant.passed
    assert "no score depends on what is on the table" in str(constant)


def test_an_answer_may_lie_where_the_last_one_lay() -> None:
    kept: dict[torch.Size, Tensor] = {}

    def into_the_same_memory(observation: Tensor) -> Tensor:
        answer = pooled(observation).detach()
        return kept.setdefault(answer.shape, torch.empty(answer.shape)).copy_(answer)

    report = check_equivariance(Answers(into_the_same_memory), ["policy: quarter turn", "policy: translation"])
    assert report.passed, report


class Flat(nn.Module):
    """A policy that says how far it sees."""

    embedding_size = 4

    def __init__(self, reach: object) -> None:
        super().__init__()
        self.reach = reach

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        return observation.mean(dim=1, keepdim=True).expand(-1, 36, -1, -1) + 0 * embedding.sum()


def test_locality_is_asked_of_what_says_how_far_it_sees() -> None:
    local = ["policy: field of view", "policy: eq. 2, every score"]
    found = check_equivariance(Flat(None), local)
    assert statuses(found) == dict.fromkeys(local, "says nothing")
    assert "it has no reach" in str(found)
    assert "see 200 pixels far" in str(check_equivariance(Flat(200), local))
    # its score is the brightness of one pixel, the same for all angles
    assert statuses(check_equivariance(Flat(0), local)) == dict.fromkeys(local, "holds")


class Unmoduled:
    """A kernel in all but its class."""

    embedding_size, in_type, out_type = 4, Says.in_type, Says.out_type


def reading(matrix: object) -> nn.Module:
    """A kernel that is read out so."""
    return type("Reads", (Says,), {"read_out": matrix})(torch.ones(1, 3, 1, 9, 9))


@pytest.mark.parametrize(
    ("module", "sentence"),
    [
        (Flat(-1), "Flat says that its scores see -1 pixels far; let reach be a number of pixels, at least 0"),
        (Flat("far"), "see 'far' pixels far"),
        (Says(torch.zeros(1, 3, 1, 8, 8)), "its size is odd, but Says makes 8 x 8; use 7 or 9"),
        (Says(torch.zeros(1, 3, 1, 9, 9, dtype=torch.int64)), "makes torch.int64 kernels, too coarse"),
        (Says(torch.zeros(1, 3, 1, 9, 9, dtype=torch.bfloat16)), "makes torch.bfloat16 kernels, too coarse"),
        (Says(torch.full((1, 3, 1, 9, 9), torch.nan)), "not finite"),
        (Says(torch.zeros(1, 5, 1, 9, 9)), r"declares kernels of shape \(1, 3, 1, k, k\).* makes \(1, 5, 1, 9, 9\)"),
        (seeded(make()).bfloat16(), "RingKernel"),
        (nn.Linear(3, 4).bfloat16(), "does not say how wide its embeddings are"),
        (object(), "aimed at a torch module, but this is object"),
        (Unmoduled(), "aimed at a torch module, but this is Unmoduled"),
        (
            Says(torch.zeros(1, 3, 1, 9, 9)),
            "a kernel of zeros from each of 8 embeddings, .* train it, or start its last",
        ),
        (reading(lambda self: 1), "Reads has a read_out that is a method; let it be a dense float tensor"),
        (reading(fields.synthesis(2).numpy()), "has a read_out that is a ndarray"),
        (reading(fields.synthesis(4)), r"has a read_out that is a torch.float64 tensor \(36, 5\); .* \(bins, 3\)"),
        (reading(fields.synthesis(2).round().long()), r"has a read_out that is a torch.int64 tensor \(36, 3\)"),
        (reading(torch.full((36, 3), torch.nan)), "has a read_out with numbers that are not finite"),
        (Answers(lambda seen: seen > 100), "makes torch.bool scores, too coarse"),
        (Answers(lambda seen: seen[:, :0]), r"makes scores of shape \(1, 0, 64, 128\), which is empty"),
        (Answers(lambda seen: seen.to("meta")), "makes scores on the device meta"),
        (Answers(lambda seen: seen.to_sparse()), "makes scores as a tensor of layout torch.sparse_coo"),
        (Answers(lambda seen: seen * torch.nan), "makes scores that are not finite"),
        (Answers(lambda seen: seen + torch.inf), "makes scores that are not finite"),
        (Answers(lambda seen: seen - torch.inf), "all minus infinity, which forbids every grasp"),
    ],
)
def test_a_module_that_cannot_be_measured_is_one_sentence(module: object, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        check_equivariance(module)


class Choosy(Flat):
    """A policy that takes some batches and sizes alone."""

    def __init__(self, takes: Callable[[int, int], bool]) -> None:
        super().__init__(None)
        self.takes = takes

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        if not self.takes(len(observation), observation.shape[2]):
            raise RuntimeError("not so")
        return super().forward(observation, embedding)


def test_what_only_a_law_asks_is_one_sentence_too() -> None:
    """A policy for few sizes takes what it is first tried on."""
    sentence = r"Choosy does not take \(1, 4, 128, 128\) and \(1, 4\), of .* \(not so\)"
    with pytest.raises(InputError, match=sentence) as error:
        check_equivariance(Choosy(lambda batch, rows: rows <= 100), ["policy: quarter turn"])
    assert "\n" not in str(error.value)


def test_a_policy_for_one_scene_at_a_time_is_measured() -> None:
    found = check_equivariance(Choosy(lambda batch, rows: batch == 1))
    assert statuses(found)["policy: quarter turn"] in ("holds", "fails")


def test_arguments_that_cannot_be_are_one_sentence() -> None:
    kernel = seeded(make())
    with pytest.raises(ValueError, match=r"does not take \(1, 5\), of embedding width 5"):
        check_equivariance(kernel, embedding_size=5)
    with pytest.raises(ValueError, match="no law 'lema 1'; did you mean 'lemma 1'"):
        check_equivariance(kernel, expected_failures={"lema 1": "a reason"})
    with pytest.raises(ValueError, match="without a reason"):
        check_equivariance(kernel, expected_failures={"lemma 1": " "})
    with pytest.raises(InputError, match=r"without a reason \(None\); say why in a sentence"):
        check_equivariance(kernel, expected_failures={"lemma 1": None})  # ty: ignore[invalid-argument-type]
    with pytest.raises(ValueError, match="not among those to check"):
        check_equivariance(kernel, ["mirror"], {"lemma 1": "a reason"})
    with pytest.raises(ValueError, match="is not about RingKernel"):
        check_equivariance(kernel, expected_failures={"group": "a reason"})
    with pytest.raises(ValueError, match="none of these laws is about RingKernel: group"):
        check_equivariance(kernel, ["group"])


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("my_kernel", "is given as my_package.my_module:make"),
        ("my_kernels:make", "cannot be imported"),
        ("my_mistake:make", "its own code raises SyntaxError"),
        ("my_mistake_in_make:make", "raises ZeroDivisionError"),
        ("my_kernel:mak", "no name in my_kernel 'mak'; did you mean 'make'"),
        ("my_kernel:Tensor.__name__", "no name in my_kernel"),
    ],
)
def test_a_name_that_leads_nowhere_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, sentence: str
) -> None:
    (tmp_path / "my_mistake.py").write_text("def make(:\n")
    (tmp_path / "my_mistake_in_make.py").write_text("def make():\n    1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(SOURCE.parent)
    with pytest.raises(ValueError, match=sentence):
        load_by_name(name)
