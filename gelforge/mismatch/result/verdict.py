"""What the judge says: verdict.json with its schema. The tables next to it are those of verdict_tables.py."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError, model_validator

from gelforge.config import Name, NonNegative, Positive, Section
from gelforge.files import read_product_json, write_product_json
from gelforge.mismatch.model.effect import FAMILIES
from gelforge.mismatch.readings.observations import SetAside
from gelforge.mismatch.result.residual import Adequacy, Mismatch
from gelforge.mismatch.result.scores import HeldOut, Probability, Score, ThreeAxes
from gelforge.mismatch.thresholds import DECISIVE, LEFT_P, SAME_READINGS_SNR, SURE

FORMAT: Final = "gelforge-verdict-5"
VERDICT, PATCH, PAGE = "verdict.json", "config.patch.yaml", "report.html"
State = Literal["consistent", "identified", "ambiguous", "inconclusive", "unexplained"]
Interval = tuple[float, float]


class VerdictError(ValueError):
    """A verdict that cannot be read: which file, what was found, what to do."""


class Where(Section):
    """Where readings differ from the nominal model; a defect has x, y and radius. Keys without meaning are left out."""

    words: str = Field(description="The place in plain words")
    channel: str | None = Field(None, description="What differs: force x, y or z, or flow")
    x_mm: float | None = Field(None, description="Centre of the region [mm]")
    y_mm: float | None = Field(None, description="Centre of the region [mm]")
    radius_mm: Positive | None = Field(None, description="Radius of the region about its centre [mm]")
    layer: str | None = Field(None, description="Layer in which a defect lies")
    depth_mm: Interval | None = Field(
        None, description="Depths of the indenter, of a defect below the top [mm]"
    )
    time_s: Interval | None = Field(None, description="Times of the recording, from and to [s]")
    snr: NonNegative | None = Field(None, description="Signal over noise of this pattern [-]")
    p: Probability | None = Field(None, description="Of as much by chance anywhere that was looked at [-]")


class ParameterEstimate(Section):
    """One fitted value of an effect."""

    name: str = Field(description="The parameter")
    unit: str = Field(description="Its unit")
    value: float = Field(description="Fitted value, 0 is the effect's absence [unit]")
    interval_90: Interval = Field(description="90 % interval [unit]")


class NamedEffect(Section):
    """An effect that was tried, with its evidence."""

    name: Name = Field(description="Canonical name")
    # a type checker wants the names themselves, which effects have in one place
    family: Literal[FAMILIES] = Field(description="Family of the effect")  # type: ignore[valid-type]
    probability: Probability = Field(description="Probability that it is part of what is missing [-]")
    log_bayes_factor: float = Field(description="Log evidence over that of the null [-]")
    snr: NonNegative | None = Field(None, description="Signal over noise of its fitted change [-]")
    parameters: list[ParameterEstimate] = Field(
        [], description="Fitted parameter values; none where it was not fitted"
    )
    hyperparameters: dict[str, float | str] = Field(
        {}, description="Place, part, time constant; keys carry units"
    )
    in_range: bool = Field(
        description="Values have their physical sign and lie inside their bounds; on a bound only where no larger value"
        " exists (a lost bond); of several values of one sign some may be zero"
    )
    refitted: bool = Field(False, description="Fitted in the finite elements; else by sensitivities only")


class Unknown(Section):
    """What no known effect explains: a smooth change by one kernel, of unknown size and form."""

    probability: Probability = Field(description="Probability that it is part of what is missing [-]")
    words: str = Field(description="The kernel that it would most probably have, together with the answer")


class Group(Section):
    """One acting effect: the smallest set of effects that holds 0.95 of its probability."""

    members: list[Name] = Field(
        min_length=1,
        description="The leading effect, then those of its line: of the same sensitivities, whatever is read",
    )
    probability: Probability = Field(description="Probability that one of the members is there [-]")
    alternatives: list[Name] = Field([], description="Other effects of the set, the most probable first")
    set_probability: Probability | None = Field(
        None, description="Probability that an effect of the set is there [-]; empty: as `probability`"
    )
    shares: dict[str, Probability] = Field({}, description="Of each effect in the set; they add up to 1 [-]")
    differs_N: NonNegative | None = Field(
        None, description="Largest difference of the readings that effects of the set predict, rms [N]"
    )
    differs_snr: NonNegative | None = Field(None, description="The same, signal over noise [-]")
    decided_by: str = Field("", description="The experiment that distinguishes them")

    def __str__(self) -> str:
        shares = {name: f" ({self.shares[name]:.0%})" if name in self.shares else "" for name in self.names}
        return f"{self.chance:.3g}: {' or '.join(f'{name}{share}' for name, share in shares.items())}"

    @property
    def chance(self) -> float:
        """Return the probability that an effect of the credible set is there."""
        return self.probability if self.set_probability is None else self.set_probability

    @property
    def names(self) -> list[str]:
        """Return the credible set."""
        return [*self.members, *self.alternatives]

    @property
    def one_patch(self) -> bool:
        """Return whether it does not matter which effect of the set is put into the study: all predict the same."""
        return self.differs_snr is not None and self.differs_snr < SAME_READINGS_SNR


class Flow(Section):
    """The camera's channel: flow of the particles in the images."""

    used: Literal["fitted", "predicted"] = Field(description="Part of the fit, or predicted by it")
    p: Probability = Field(description="Of the nominal model's residual by chance [-]")
    rmse_before_px: NonNegative = Field(description="Root mean square of measured minus predicted flow [px]")
    rmse_after_px: NonNegative | None = Field(None, description="The same with the effect in it [px]")


class Fit(Section):
    """The nominal model, without and with the effect, compared with the readings."""

    before: Score = Field(description="The nominal model on all readings")
    after: Score | None = Field(None, description="With the effect in it, on all readings")
    held_out: HeldOut | None = Field(None, description="All blocks that were held out, together")
    held_out_blocks: list[HeldOut] = Field([], description="Each of them")
    flow: Flow | None = Field(None, description="The images' channel, where there is one")


class DetectionLimit(Section):
    """The smallest value of an effect that these readings would show."""

    effect: Name = Field(description="Canonical name")
    parameter: str = Field(description="The parameter")
    unit: str = Field(description="Its unit")
    value: Positive | None = Field(description="Smallest value that would be seen [unit]; empty: none would")
    plausible: Positive = Field(description="A plausible value, the standard deviation of its prior [unit]")

    @property
    def seen(self) -> bool:
        """Return whether a plausible value would be seen."""
        return self.value is not None and self.value <= self.plausible


class Noise(Section):
    """The errors that were allowed for: standard deviations, root mean square over readings."""

    stated_N: ThreeAxes = Field(description="Of one reading, x, y, z [N]")
    zero_N: ThreeAxes = Field(description="Of the subtracted zero, one draw per indentation, x, y, z [N]")
    press_depth_mm: NonNegative = Field(0.0, description="Of the depth, one draw per indentation [mm]")
    session_depth_mm: NonNegative = Field(0.0, description="Of the depth, one draw per session [mm]")
    floor_N: ThreeAxes = Field(description="Of the nominal model's discretisation, x, y, z [N]")
    law_N: ThreeAxes = Field(description="Of its fitted constitutive models, x, y, z [N]")


class Experiment(Section):
    """An experiment that would decide."""

    words: str = Field(description="What to do")
    separates: list[Name] = Field(description="What it distinguishes")
    presses: int | None = Field(None, ge=0, description="Indentations that it takes [-]")
    cost_s: NonNegative | None = Field(None, description="Time that it takes [s]")
    expected_log_odds: float | None = Field(None, description="Expected log odds of the right one [-]")

    @property
    def decides(self) -> bool:
        """Return whether odds of ten are expected."""
        return (self.expected_log_odds or 0.0) >= DECISIVE


class Model(Section):
    """What no known effect explains, modelled as a smooth change: of a cause with a free form, or a numeric correction."""

    cause: Name | None = Field(
        None, description="Cause with a free form, whose map module.csv has; empty: without a cause"
    )
    probability: Probability | None = Field(
        None, description="That this cause is part of what is missing [-]"
    )
    words: str = Field(description="What it changes, and over what")
    with_effects: list[Name] = Field([], description="Identified effects that act together with it")
    largest_N: ThreeAxes = Field(description="Largest change of a reading, x, y, z [N]")
    depth_mm: Interval = Field(description="Depths that it was learnt from; it is not extrapolated [mm]")
    sites: int = Field(ge=1, description="Positions that it was learnt from [-]")
    corrects_labels: bool = Field(description="It is a function of depth and place: correction.csv has it")
    held_out: HeldOut = Field(description="Readings held out, without it and with it")

    @property
    def sure(self) -> bool:
        """Return whether it has a cause, as probable as a claim has to be."""
        return self.cause is not None and (self.probability or 0.0) >= SURE


class Layer(Section):
    """A soft layer."""

    name: str = Field(description="Its name")
    z_mm: Interval = Field(description="From its lower to its upper face, 0 at the top of the sensor [mm]")


class SensorShape(Section):
    """What the page needs to draw the sensor."""

    width_x_mm: Positive = Field(description="Size along x [mm]")
    width_y_mm: Positive = Field(description="Size along y [mm]")
    layers: list[Layer] = Field([], description="Soft layers, from the base up")


class Provenance(Section):
    """What the verdict rests on."""

    sessions: dict[str, str] = Field(description="SHA-256 over the SHA-256 of each session's files")
    base: str = Field(description="The nominal model in words: study, or table of forces")
    base_sha256: str = Field(description="SHA-256 of the nominal model's settings or table")
    seed: int = Field(description="Of every draw")
    draws: int = Field(ge=0, description="Of the maximum statistic [-]")
    versions: dict[str, str] = Field(description="Of gelforge and of the libraries")


class Verdict(Section):
    """The verdict on one recording of a study."""

    format: Literal["gelforge-verdict-5"] = Field(FORMAT, description="Of this file")
    title: str = Field(description="What was judged, a few words")
    synthetic: bool = Field(description="Readings come from a virtual lab or another solver, not a sensor")
    state: State = Field(description="What was found")
    sentence: str = Field(min_length=1, description="The verdict in one plain sentence")
    mismatch: Mismatch = Field(description="Whether there is anything to explain")
    where: list[Where] = Field([], description="Where, the strongest first; then the located defects")
    answer: list[Group] = Field(
        [], description="What is missing: one effect of each group is there, the most probable group first"
    )
    effects: list[NamedEffect] = Field([], description="All that were tried, the most probable first")
    unknown: Unknown | None = Field(None, description="The discrepancy: what no known effect explains")
    null_probability: Probability = Field(description="Probability that nothing is missing [-]")
    fit: Fit = Field(description="Before and after, on all readings and on those held out")
    adequacy: Adequacy | None = Field(None, description="What remains after the answer")
    model: Model | None = Field(None, description="What is modelled although its cause is unknown")
    detection_limits: list[DetectionLimit] = Field([], description="What these readings would show")
    noise: Noise = Field(description="Errors that were allowed for")
    next_experiments: list[Experiment] = Field([], description="What would decide, the best first")
    cannot_know: list[str] = Field([], description="What these readings cannot show and why, a sentence each")
    outliers: list[SetAside] = Field([], description="Readings that were left out")
    sensor: SensorShape | None = Field(None, description="The sensor as drawn; empty for a material test")
    provenance: Provenance = Field(description="What the verdict rests on")
    tables: dict[str, str] = Field({}, description="SHA-256 of each table in the same folder, by its name")

    def __repr__(self) -> str:
        groups = (f"  {group}" for group in self.answer)
        synthetic = " (SYNTHETIC)" if self.synthetic else ""
        lines = [f"Verdict on {self.title}{synthetic}: {self.state}", f"  {self.sentence}", *groups]
        return "\n".join([*lines, f"  Next: {self.next_step}"])

    __str__ = __repr__

    @property
    def identified(self) -> bool:
        """Return whether the missing physics has a name."""
        return self.state == "identified"

    @property
    def next_step(self) -> str:
        """Return what to do next, in one line."""
        if self.state == "consistent":
            if self.mismatch.differs:
                return "Record more indentations and judge all sessions together."
            return "Use the labels as they are."
        if self.model is not None and self.model.corrects_labels and not self.identified:
            return "Correct simulated forces by correction.csv within its depths and positions."
        if self.next_experiments and not self.identified:
            best = self.next_experiments[0]
            return f"To distinguish {' and '.join(best.separates).replace('_', ' ')}: {best.words}."
        if self.state == "unexplained":
            return "Check the setup where the readings differ most; the map below shows where."
        if not self.answer and self.state == "inconclusive":
            return "Record what `gelforge mismatch plan` proposes."
        return f"Merge {PATCH} into the study and run it again."

    @property
    def sure(self) -> list[Group]:
        """Return the groups of the answer that are as probable as a claim has to be."""
        return [group for group in self.answer if group.probability >= SURE]

    @model_validator(mode="after")
    def _consistent(self) -> Verdict:
        for fault in self._faults():
            raise ValueError(fault)
        return self

    def _faults(self) -> Iterator[str]:
        """Yield why the state claims more than the numbers show."""
        effects = {effect.name: effect for effect in self.effects}
        free_cause = self.model is not None and self.model.sure
        if unknown := [name for group in self.answer for name in group.names if name not in effects]:
            yield f"answer names {unknown}, which are not among the effects; list every effect that was tried"
        if self.state in ("identified", "ambiguous") and not self.answer and not free_cause:
            yield f"state {self.state} without an answer; give its groups"
        if self.state == "consistent" and self.answer:
            yield f"state consistent with the answer {[g.names for g in self.answer]}; leave the answer out"
        if self.answer and self.fit.after is None:
            yield "an answer without a fit after it; give fit.after"
        if not self.identified:
            return
        if not self.sure and not free_cause:
            most = max(group.probability for group in self.answer)
            yield f"identified, but no line of effects has a probability of {SURE:g}, the largest is {most:g}: ambiguous"
        for group in self.sure:
            if not effects[group.members[0]].in_range:
                yield f"identified, but {group.members[0]} is outside its physical range or on its bounds: unexplained"
        if self.model is None and (self.adequacy is None or not self.adequacy.passed):
            yield f"identified, but what remains is not noise (adequacy p > {LEFT_P:g} is needed): unexplained"


def versions() -> dict[str, str]:
    """Return the versions that decide the numbers."""
    return {name: version(name) for name in ("gelforge", "numpy", "scipy", "pandas")}


def schema() -> dict[str, Any]:
    """Return the JSON schema of verdict.json; config/verdict_schema.json holds it."""
    described = Verdict.model_json_schema()
    checksum = {"description": "sha256: and the SHA-256 of the file with these digits zero", "type": "string"}
    return described | {"properties": described["properties"] | {"checksum": checksum}}


def write_verdict(folder: str | Path, verdict: Verdict) -> None:
    """Write verdict.json into a folder, whole or not at all."""
    write_product_json(Path(folder) / VERDICT, verdict.model_dump(mode="json"))


def read_verdict(folder: str | Path) -> Verdict:
    """Return the verdict in a folder.

    Parameters
    ----------
    folder : str or Path
        Holds verdict.json.

    Returns
    -------
    Verdict
        Validated.

    Raises
    ------
    VerdictError
        For a file that is missing, damaged, edited or of another form.
    """
    path = Path(folder) / VERDICT
    content = read_product_json(path, "write it anew with `gelforge mismatch`", VerdictError)
    try:
        return Verdict.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(whole file)"
        raise VerdictError(f"{path}: {key}: {first['msg']}; write it anew with `gelforge mismatch`") from None
