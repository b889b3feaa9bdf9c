"""Scores of judged cases: rates with Wilson's intervals, calibration, coverage, gain on held-out readings, distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

CONFIDENT, STRONG = 0.9, 8.0
SEPARABLE = 6.0  # signal-to-noise ratio of the difference to the best other effect, from which one should be identified
WIDTH_90 = 3.29  # standard deviations from end to end of a 90 % interval
LEVEL = 0.01  # of each of the tests of the judge
SNR_BANDS = ((2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, np.inf))
SAYS_NOTHING = ("consistent", "inconclusive")
NAMES = ("identified",)
NO_NAME = ("unexplained",)
# Effects of one value that a cause with a free form has as its even part, or as a map of one kind: it is right of these.
GENERALISED = {
    "modulus_map": (
        *("gel_stiffness", "skin_stiffness", "body_stiffness", "wall_stiffness", "wall_gap"),
        *("void", "inclusion"),
    ),
    "depth_map": ("contact_zero", "tilt"),
    "gain_in_time": ("force_gain", "body_stiffness"),
    "relaxation": ("viscoelastic",),
    "softening": ("mullins",),
    "strain_energy": ("law_exponent",),
    "friction": ("friction", "friction_law", "frictionless"),
    "force_hysteresis": ("force_hysteresis",),
}
# States of verdicts of formats 1 and 2, which archived sets have; a group was identified where it was as probable as a name.
FORMER = {"null": "consistent", "named": "identified", "open": "unexplained", "insufficient": "inconclusive"}
FORMER |= {"form_free": "identified", "modelled": "unexplained"}


@dataclass(frozen=True)
class Rate:
    """k of n, with Wilson's interval (Wilson 1927, doi 10.1080/01621459.1927.10502953)."""

    k: int
    n: int

    @property
    def value(self) -> float:
        return self.k / self.n if self.n else float("nan")

    def interval(self, z: float = 1.959963984540054) -> tuple[float, float]:
        """Return the bounds (low, high); nothing known: 0 to 1."""
        if not self.n:
            return 0.0, 1.0
        p, n = self.value, self.n
        middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))

    @property
    def words(self) -> str:
        low, high = self.interval()
        return f"{self.k}/{self.n} = {self.value:.1%} ({low:.1%} to {high:.1%})" if self.n else "none"


@dataclass(frozen=True)
class Judged:
    """What a method said of a case, next to the truth: the tool and the baselines are scored alike."""

    content: str
    snr: float
    true: tuple[str, ...]  # names; "" outside the catalogue
    state: str
    answer: tuple[tuple[tuple[str, ...], float], ...]  # groups with their probability
    covered: tuple[bool, ...] = ()  # 90 % intervals of values that both forms have
    gain: float = float("nan")  # share of the oracle's on held-out readings
    rmse_ratio: float = float("nan")  # after over oracle, held out
    left: float = float("nan")  # of the true change on held-out readings, in standard deviations
    distance_mm: float = float("nan")
    p: float = float("nan")  # the smaller one of the tests of whether there is a mismatch
    snr_each: tuple[float, ...] = ()  # of each true effect by itself
    short: tuple[float, ...] = ()  # by which values are too small, in standard deviations, as `covered`
    # of each group those that are claimed; None: all of it
    lines: tuple[tuple[str, ...], ...] | None = None
    separation: float = float(
        "nan"
    )  # what the best fit of any other effect leaves, as a signal-to-noise ratio

    @property
    def alarm(self) -> bool:
        return self.state not in SAYS_NOTHING

    @property
    def claims(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        """Return the groups that are claimed; those that other states keep are hints, not claims."""
        if self.state not in NAMES:
            return ()
        if self.lines is None:
            return self.answer
        return tuple((line, p) for line, (_, p) in zip(self.lines, self.answer, strict=True))

    @property
    def found(self) -> list[bool]:
        """Return for each true effect whether a claimed group holds it."""
        return [any(name in members for members, _ in self.claims) for name in self.true]

    @property
    def first(self) -> bool:
        """Return whether the first member of the first group is a true effect."""
        return bool(self.claims) and self.claims[0][0][0] in self.true

    @property
    def wrong_and_confident(self) -> bool:
        return any(p >= CONFIDENT and not set(members) & set(self.true) for members, p in self.claims)


def state_of(verdict: dict) -> str:
    """Return the state of a verdict of any format, in the words of this one."""
    said = verdict["state"]
    if said == "group":
        sure = any(group["probability"] >= CONFIDENT for group in verdict["answer"])
        return "identified" if sure else "ambiguous"
    return FORMER.get(said, said)


def answer_of(verdict: dict) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Return the groups of a verdict of any format with their probability: members, then what may be there instead.

    A cause with a free form that is claimed is the first group: its name, then the effects that it generalises.
    """
    return cause_of(verdict) + tuple(
        (
            (*group["members"], *group.get("or_else", group.get("alternatives", ()))),
            float(group["probability"]),
        )
        for group in verdict.get("answer", [])
    )


def lines_of(verdict: dict) -> tuple[tuple[str, ...], ...] | None:
    """Return of each group of `answer_of` the effects that its probability is of; None of a former format: all of them."""
    groups = verdict.get("answer", [])
    if not any("alternatives" in group for group in groups):
        return None
    return tuple(names for names, _ in cause_of(verdict)) + tuple(tuple(group["members"]) for group in groups)


def cause_of(verdict: dict) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Return the cause with a free form that a verdict claims, as a group; none where it claims none."""
    model = verdict.get("model") or {}
    cause, p = model.get("cause"), float(model.get("probability") or 0.0)
    if cause is None or p < CONFIDENT or state_of(verdict) not in NAMES:
        return ()
    return (((cause, *GENERALISED.get(cause, ())), p),)


def judged_from(truth: dict, verdict: dict | None, readings: pd.DataFrame | None) -> Judged:
    """Return what a verdict said next to the truth; no verdict is the state `failed`."""
    true = tuple(effect["name"] for effect in truth["effects"])
    by_effect = tuple(float(effect["snr"]) for effect in truth["effects"])
    if verdict is None:
        return Judged(truth["content"], truth["snr"], true, "failed", (), snr_each=by_effect)
    gain, ratio, left = (
        held_out_gain(truth, readings) if truth["effects"] and readings is not None else 3 * (np.nan,)
    )
    reported = _values(truth, verdict)
    covered = tuple(low <= value <= high for value, _, (low, high) in reported)
    short = tuple(
        np.sign(x) * (x - said) * WIDTH_90 / max(high - low, 1e-12) for x, said, (low, high) in reported
    )
    return Judged(
        truth["content"], truth["snr"], true, state_of(verdict), answer_of(verdict), covered, gain, ratio, left,
        _distance(truth, verdict), _p(verdict), by_effect, short, lines_of(verdict),
        truth.get("separation", {}).get("snr", np.nan),
    )  # fmt: skip


def _p(verdict: dict) -> float:
    tests = verdict.get("mismatch", {})
    found = [tests.get(name) for name in ("p", "scan_p", "unknown_p", "known_p")]
    return min((p for p in found if p is not None), default=float("nan"))


def held_out_gain(truth: dict, readings: pd.DataFrame) -> tuple[float, float, float]:
    """Return of held-out readings the share of the oracle's gain, the RMSE after over the oracle's, and what is left.

    RMSE in standard deviations; what is left is that of the oracle less after, over that of the oracle less base.

    The oracle is the truth itself, without depth errors and noise: a stricter one than the tool's own model refitted.
    """
    said = truth["readings"]
    names = [(s, round(t, 3)) for s, t in zip(session_names(truth), said["time_s"])]
    oracle = dict(zip(names, said["force_N"]))
    rows = readings[readings["held_out"].astype(str) != "no"]
    if rows.empty:
        return np.nan, np.nan, np.nan
    axis = rows["axis"].map({"x": 0, "y": 1, "z": 2, "Fx": 0, "Fy": 1, "Fz": 2}).to_numpy()
    best = np.array([
        oracle[s, round(t, 3)][a] for s, t, a in zip(rows["session"], rows["time_s"], axis)
    ])  # fmt: skip
    measured, sigma = rows["measured_N"].to_numpy(), rows["sigma_N"].to_numpy()
    base = rows["base_N"].to_numpy(dtype=float)
    # Of older verdicts after_N is what the training readings predict
    unseen = "predicted_N" if "predicted_N" in rows else "after_N"
    after = pd.to_numeric(rows[unseen], errors="coerce").to_numpy()
    after = np.where(np.isfinite(after), after, base)
    square = [float(np.mean(((measured - other) / sigma) ** 2)) for other in (base, after, best)]
    change, rest = (float(np.mean(((best - other) / sigma) ** 2)) for other in (base, after))
    left = np.sqrt(rest / change) if change > 0 else np.nan
    return share_of_gain(*square), float(np.sqrt(square[1] / square[2])), float(left)


def share_of_gain(before: float, after: float, oracle: float) -> float:
    """Return (before - after) / (before - oracle) of mean squares; nan where there was little to gain."""
    return (before - after) / (before - oracle) if before - oracle > 0.05 * oracle else float("nan")


def session_names(truth: dict) -> list[str]:
    """Return the session's name of each reading (R,) of a truth."""
    return [f"{truth['case']}_{chr(ord('a') + int(s))}" for s in truth["readings"]["session"]]


def _values(truth: dict, verdict: dict) -> list[tuple[float, float, tuple[float, float]]]:
    """Return true values, reported ones and their 90 % intervals, of effects that are the first of a claimed group."""
    if state_of(verdict) not in NAMES:
        return []
    first = {g["members"][0] for g in verdict["answer"]}
    by_name = {e["name"]: e for e in verdict["effects"] if e["name"] in first}
    found = []
    for effect in truth["effects"]:
        said = {a["name"]: a for a in by_name.get(effect["name"], {}).get("parameters", [])}
        for parameter, value in effect["parameters"].items():
            if parameter in said:
                found.append((value, said[parameter]["value"], tuple(said[parameter]["interval_90"])))
    return found


def _distance(truth: dict, verdict: dict) -> float:
    """Return how far a claimed defect is from the true one [mm]; nan where there is none or none was claimed.

    Claimed is a located effect of the answer as it was fitted; of another name than the true one it is a wrong group.
    """
    if state_of(verdict) not in NAMES:
        return float("nan")
    claimed = {name for names, _ in answer_of(verdict) for name in names}
    grid = {e["name"]: e.get("hyperparameters", {}) for e in verdict["effects"] if e["name"] in claimed}
    places = [(e["where"], grid.get(e["name"], {})) for e in truth["effects"] if "where" in e]
    away = [np.hypot(a["x_mm"] - b["x_mm"], a["y_mm"] - b["y_mm"]) for a, b in places if "x_mm" in b]
    return float(min(away, default=np.nan))


def scores(judged: list[Judged]) -> dict[str, str | float | Rate]:
    """Return all scores by their names, in the order of the table."""
    of = lambda *contents: [j for j in judged if j.content in contents]  # noqa: E731
    rate = lambda items, test: Rate(sum(map(test, items)), len(items))  # noqa: E731
    nulls, singles, pairs, outside = of("null"), of("single"), of("pair"), of("outside")
    strong = [j for j in singles if j.snr >= STRONG]
    table: dict[str, str | float | Rate] = {
        "cases": str(len(judged)),
        "failed": rate(judged, lambda j: j.state == "failed"),
        "false alarms on nulls": rate([j for j in nulls if j.state != "failed"], lambda j: j.alarm),
        "inconclusive on nulls": rate(nulls, lambda j: j.state == "inconclusive"),
        f"a test below {LEVEL:g} on nulls": rate(
            [j for j in nulls if np.isfinite(j.p)], lambda j: j.p < LEVEL
        ),
        "wrong and confident": rate(judged, lambda j: j.wrong_and_confident),
        f"singles, SNR >= {STRONG:g}: group": rate(strong, lambda j: all(j.found)),
        f"singles, SNR >= {STRONG:g}: first": rate(strong, lambda j: j.first),
    }
    table[f"singles, SNR >= {STRONG:g}: a claim of {CONFIDENT:g} and more"] = rate(
        strong, lambda j: any(p >= CONFIDENT for _, p in j.claims)
    )
    for low, high in SNR_BANDS:
        band = [j for j in singles if low <= j.snr < high]
        table[f"singles, SNR {low:g} to {high:g}: group"] = rate(band, lambda j: all(j.found))
        table[f"singles, SNR {low:g} to {high:g}: first"] = rate(band, lambda j: j.first)
    sizes = [len(members) for j in strong for members, _ in j.claims if set(members) & set(j.true)]
    table["median size of right groups"] = float(np.median(sizes)) if sizes else float("nan")
    table["pairs: both"] = rate(pairs, lambda j: all(j.found))
    table[f"pairs, each SNR >= {STRONG:g}: both"] = rate(
        [j for j in pairs if j.snr_each and min(j.snr_each) >= STRONG], lambda j: all(j.found)
    )
    table["pairs: one at least"] = rate(pairs, lambda j: any(j.found))
    effects = [found for j in (*singles, *pairs) for found, snr in zip(j.found, j.snr_each) if snr >= STRONG]
    table[f"effects of singles and pairs, SNR >= {STRONG:g}: in a group"] = rate(effects, bool)
    table["outside: no name"] = rate(outside, lambda j: j.state in NO_NAME)
    strange = [j for j in outside if j.snr >= STRONG]
    table[f"outside, SNR >= {STRONG:g}: no name"] = rate(strange, lambda j: j.state in NO_NAME)
    table[f"outside, SNR >= {STRONG:g}: not wrongly named"] = rate(
        strange, lambda j: not j.wrong_and_confident
    )
    table |= calibration(judged)
    covered = [c for j in judged for c in j.covered]
    table["90 % intervals: cover"] = rate(covered, bool)
    short = np.array([s for j in judged for s in j.short])
    table["values too small by, mean [sd]"] = float(short.mean()) if len(short) else float("nan")
    table["values off by, root mean square [sd]"] = (
        float(np.sqrt(np.mean(short**2))) if len(short) else float("nan")
    )
    gains = [j.gain for j in judged if np.isfinite(j.gain) and j.content == "single" and j.snr >= STRONG]
    table["share of the oracle's gain, median"] = float(np.median(gains)) if gains else float("nan")
    table["share of the oracle's gain >= 80 %"] = rate(gains, lambda g: g >= 0.8)
    ratios = [j.rmse_ratio for j in judged if np.isfinite(j.rmse_ratio)]
    table["held-out RMSE over the oracle's, median"] = float(np.median(ratios)) if ratios else float("nan")
    rests = [
        j.left
        for j in judged
        if np.isfinite(j.left) and j.content == "single" and j.snr >= STRONG and all(j.found)
    ]
    table["left of the change where the group is right, median"] = (
        float(np.median(rests)) if rests else float("nan")
    )
    away = [j.distance_mm for j in judged if np.isfinite(j.distance_mm)]
    table["located defect, median distance [mm]"] = float(np.median(away)) if away else float("nan")
    table["located defect within 3 mm"] = rate(away, lambda d: d <= 3.0)
    return table


def calibration(judged: list[Judged]) -> dict[str, str | float | Rate]:
    """Return Brier and log score of claimed groups' probabilities, and how often they are right by probability."""
    claims = [(p, bool(set(members) & set(j.true))) for j in judged for members, p in j.claims]
    if not claims:
        return {"Brier score of claims": float("nan"), "log score of claims": float("nan")}
    p, right = np.array([c[0] for c in claims]), np.array([c[1] for c in claims], dtype=float)
    safe = np.clip(p, 1e-3, 1 - 1e-3)
    table: dict[str, str | float | Rate] = {
        "Brier score of claims": float(np.mean((p - right) ** 2)),
        "log score of claims": float(np.mean(right * np.log(safe) + (1 - right) * np.log(1 - safe))),
    }
    for low, high in ((0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)):
        mine = (p >= low) & (p < high)
        if mine.any():
            table[f"claims of probability {low:g} to {min(high, 1):g}: right"] = Rate(
                int(right[mine].sum()), int(mine.sum())
            )
    return table


def table_of(methods: dict[str, dict]) -> pd.DataFrame:
    """Return one row per score and one column per method."""
    names = list(dict.fromkeys(name for scored in methods.values() for name in scored))
    rows = [
        {"score": name, **{m: _words(scored.get(name)) for m, scored in methods.items()}} for name in names
    ]
    return pd.DataFrame(rows)


def wrong_cases(named: list[tuple[str, dict, Judged]]) -> pd.DataFrame:
    """Return the cases that were got wrong: what was hidden, what was said."""
    rows = []
    for name, truth, j in named:
        good = {
            "null": not j.alarm,
            "single": all(j.found) or (not j.alarm and j.snr < STRONG),
            "pair": all(j.found),
            "outside": j.state in NO_NAME or (not j.alarm and j.snr < STRONG),
        }[j.content]
        if good and not j.wrong_and_confident and j.state != "failed":
            continue
        hidden = "; ".join(
            f"{e['name'] or 'outside'} ({e['form']}, SNR {e['snr']:.1f})" for e in truth["effects"]
        )
        said = "; ".join(f"{' | '.join(members)} ({p:.2f})" for members, p in j.answer)
        rows.append({"case": name, "content": j.content, "hidden": hidden, "state": j.state, "answer": said})
    return pd.DataFrame(rows, columns=["case", "content", "hidden", "state", "answer"])


def _words(value) -> str:
    if isinstance(value, Rate):
        return value.words
    if isinstance(value, float):
        return f"{value:.3g}" if np.isfinite(value) else "none"
    return value or ""
