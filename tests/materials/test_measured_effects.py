"""Effects found in whole folders: which tests are compared, what is written, and what is said not to be known."""

import json

import numpy as np
import pandas as pd
import pytest
from test_histories import cyclic, loading, relaxed, virgin

from gelforge.config import Fitting, Material
from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.measured_effects import INFORMS
from gelforge.materials.basis.segments import find_segments
from gelforge.materials.characterise import characterise, characterise_source
from gelforge.materials.fits import measured_effects
from gelforge.materials.fitting.fit import FitError
from gelforge.materials.fitting.law_file import read_law
from gelforge.materials.readers.material_source import MaterialSource, read_sources, source_files, source_of


def effects_of(tests):
    return measured_effects(MaterialSource("gel", tuple(tests)))


def named(effects, name):
    return [e for e in effects.effects if e.effect == name]


def aged(count, change, rng, **known):
    return [
        loading(1 + change * (days > 0), f"s{k}_{days}", rng, age_days=days, rate_per_s=0.003, **known)
        for days in (0, 63)
        for k in range(count)
    ]


def test_ageing_is_found_among_like_tests_and_not_where_covariates_change_together():
    # Ageing is found among tests alike in rate and named after its physics
    found = effects_of(aged(6, 0.3, np.random.default_rng(0)))
    [age] = named(found, "age")
    assert age.verdict == "significant stiffening"
    assert age.interval[0] < 0.3 < age.interval[1]
    assert age.parameters["span"] == [0.0, 63.0]
    assert "From 0 to 63 days" in age.sentence and "significant stiffening" in age.sentence
    assert INFORMS["age"] == ("ageing",)
    assert "strain_rate" in {effect for effect, _ in found.not_judged}

    # Covariates that change together or hardly are not judged
    rng = np.random.default_rng(1)
    tests = [
        loading(1 + 0.3 * (d > 0), f"s{d}{k}", rng, age_days=d, temperature_C=20 + d)
        for d in (0, 63)
        for k in range(4)
    ]
    found = effects_of(tests)
    assert not named(found, "age") and not named(found, "temperature")
    reasons = dict(found.not_judged)
    assert "only together with other covariates" in reasons["age"]

    # Rates a tenth apart are one rate
    rng = np.random.default_rng(2)
    found = effects_of([loading(1, f"s{k}", rng, rate_per_s=0.003 * (1 + 0.05 * k)) for k in range(4)])
    assert not named(found, "strain_rate")
    assert "alike" in dict(found.not_judged)["strain_rate"]


def test_later_cycles_soften_and_a_hold_is_part_of_a_cycles_loss():
    # Later cycles are softening
    rng = np.random.default_rng(3)
    first = [loading(1, f"s{k}", rng, cycle=1) for k in range(5)]
    second = [loading(0.8, f"s{k}", rng, cycle=2) for k in range(5)]
    [soft] = named(effects_of(first + second), "softening")
    assert soft.verdict == "significant softening"
    assert soft.interval[0] < -0.2 < soft.interval[1]
    assert soft.samples == ("s0", "s1", "s2", "s3", "s4")

    # Cycles in one test give hysteresis softening and ogden roxburgh
    tests = [cyclic(2.0, 2.0, factor=f) for f in (1.0, 1.1, 0.95)]
    found = effects_of(tests)
    [hysteresis], [soft], [law] = (named(found, n) for n in ("hysteresis", "softening", "ogden_roxburgh"))
    assert hysteresis.verdict == "significant hysteresis" and hysteresis.interval[0] > 0.2
    assert soft.verdict == "significant softening"
    assert law.interval[0] < 1.6 < law.interval[1]  # R of test_histories

    # Relaxation in a hold is said to be part of a cycles loss
    t = np.r_[np.linspace(0, 5, 50), np.linspace(6, 100, 60), np.linspace(101, 106, 50)]
    lam = np.interp(t, [0, 5, 100, 106], [1, 1.5, 1.5, 1])
    stress = virgin(lam) * np.where(t <= 5, 1, 0.6)
    segments = find_segments(lam, t)
    assert [s.kind for s in segments] == ["load", "hold", "unload"]
    test = MaterialTest("uniaxial", "h", lam, stress, t, history="relaxation", segments=segments)
    [loop] = named(effects_of([test]), "hysteresis")
    assert loop.value == pytest.approx(0.4, abs=0.01)  # trapezoids between 50 rows
    assert "relaxation in its holds included" in loop.sentence
    [cycle] = named(effects_of([cyclic(2.0, 2.0)]), "hysteresis")
    assert "holds" not in cycle.sentence


def held(sample, equilibrium=1.0, stretch=1.5, **known):
    t = np.r_[np.linspace(0, 5, 50, endpoint=False), 5 + np.geomspace(0.02, 500, 300)]
    lam = np.interp(t, [0, 5, 600], [1, stretch, stretch])
    decay = relaxed(np.maximum(t - 5, 0), 5.0)
    stress = np.where(t < 5, virgin(lam), virgin(stretch) * (decay / decay[0]) ** equilibrium)
    return MaterialTest(
        "uniaxial", sample, lam, stress, t, history="relaxation", segments=find_segments(lam, t), **known
    )


def test_relaxation_is_averaged_over_holds_at_one_stretch():
    found = named(effects_of([held(f"s{k}") for k in range(3)]), "relaxation")
    assert len(found) == 4 and found[-1].quantity.startswith("share of stress lost within the time")
    begin, end = found[-1].parameters["time_s"]
    start, last = relaxed(np.array([begin, end]), 5.0)
    assert end > 450 and found[-1].value == pytest.approx(
        1 - last / start, abs=0.01
    )  # rms of a Prony fit: 0.5 %
    # an ideal step loses 0.25 + 0.15 (1 - exp(-5)) in 500 s; the fast share rests on extrapolation over the ramp
    step = found[-1].parameters["drop_of_an_ideal_step"]
    assert step == pytest.approx(0.25 + 0.15 * (1 - np.exp(-5)), abs=0.02) and step > found[-1].value + 0.05
    assert found[0].parameters["prony_times_s"]
    two = effects_of([held("a", age_days=0), held("b", 1.15, age_days=30)])
    share = next(e for e in named(two, "age") if "left from" in e.quantity)
    assert share.interval is None and share.parameters["scatter_to_explain"] > 0
    # both relax alike but for the exponent: the measured share of the second is (last / start)^1.15
    assert share.value == pytest.approx((last / start) ** 0.15 - 1, abs=0.01)

    # Holds at other stretches are no repeats
    stretches = (1.25, 1.5, 2.0, 1.27, 1.26)
    found = named(effects_of([held(f"s{k}", stretch=s) for k, s in enumerate(stretches)]), "relaxation")
    assert len(found) == 6 and found[-1].samples == ("s0", "s3", "s4")
    aged = effects_of([held("a", age_days=0, stretch=1.5), held("b", age_days=30, stretch=2.0)])
    assert not [e for e in named(aged, "age") if "left from" in e.quantity]


def test_a_treatment_counted_in_doses_and_curves_that_cross():
    """A treatment that softens at small strain and stiffens at large strain: the mean alone would hide it."""
    lam = np.linspace(1.0, 2.0, 80)
    turned = virgin(lam) * np.exp(0.6 * (lam - 1.6))
    tests = [MaterialTest("uniaxial", "a", lam, virgin(lam), dose=0.0)]
    tests += [MaterialTest("uniaxial", "b", lam, turned, dose=1.0)]
    [effect] = named(effects_of(tests), "treatment")
    assert INFORMS["treatment"] == ("ageing",)
    assert effect.parameters["change_at_smallest_and_largest_strain"] == pytest.approx(
        [np.expm1(0.6 * -0.4), np.expm1(0.6 * 0.4)],
        abs=0.005,  # strains 0.2 and 1, between rows
    )
    assert "by -21.3% at the smallest strain and +27.1% at the largest" in effect.sentence
    assert effect.verdict == "undecided" and effect.interval is None
    assert "judged without repeats" in effect.sentence and "no more than the 10%" in effect.sentence
    [strong] = named(effects_of([tests[0], loading(1.5, "c", dose=1.0)]), "treatment")
    # two samples that scatter by s differ by 1.96 sqrt(2) s once in 20 pairs
    assert strong.parameters["scatter_to_explain"] == pytest.approx(
        np.log(1.5) / (1.96 * np.sqrt(2)), rel=1e-3
    )
    assert strong.verdict == "significant stiffening" and "more than the 10%" in strong.sentence
    assert "on average" not in strong.sentence  # a factor at every strain


def test_every_effect_names_a_physics_and_what_is_not_tested_is_said():
    found = effects_of([loading(1, "s1"), loading(1.01, "s2")])
    assert not found.effects
    assert {effect for effect, _ in found.not_judged} == {
        "strain_rate", "age", "temperature", "relaxation", "hysteresis", "softening", "lateral_contraction", "friction",
    }  # fmt: skip
    assert all(INFORMS[effect] for effect, _ in found.not_judged)


# ----------------------------------------------------------------------------------------------- whole folders
def write(folder, name, **columns):
    pd.DataFrame(columns).to_csv(folder / name, index=False, float_format="%.8g")


@pytest.fixture
def folder(tmp_path):
    """Return a material's folder: two ages, a hold, cycles, tilt trials, sections and a press of a ball."""
    folder = tmp_path / "gel"
    folder.mkdir()
    rows, rng = ["file,test,sample,width_mm,thickness_mm,age_days,history"], np.random.default_rng(4)
    lam = np.linspace(1, 2, 60)
    for days in (0, 63):
        for k in range(4):
            factor = (1 + 0.3 * (days > 0)) * np.exp(rng.normal(0, 0.02))
            force = factor * virgin(lam) * 5.0
            write(folder, f"u{days}_{k}.csv", time_s=300 * (lam - 1), force_N=force, stretch_1=lam)
            rows.append(f"u{days}_{k}.csv,uniaxial,s{days}_{k},10,,{days},")
    hold, loop = held("r"), cyclic(1.8, 1.8)
    write(folder, "r.csv", time_s=hold.time_s, force_N=5 * hold.nominal_stress, stretch_1=hold.stretch)
    write(folder, "c.csv", time_s=loop.time_s, force_N=5 * loop.nominal_stress, stretch_1=loop.stretch)
    rows += ["r.csv,relaxation,r,10,0.5,,", "c.csv,uniaxial,c,10,0.5,,cyclic"]
    (folder / "samples.csv").write_text("\n".join(rows) + "\n")
    (folder / "friction.csv").write_text("trial,tilt_deg\na,24\nb,25\nc,24.5\n")
    sections = "".join(
        f"s{d}_{k},{i},{0.5 + 0.002 * i}\n" for d in (0, 63) for k in range(4) for i in (-1, 0, 1)
    )
    (folder / "thickness.csv").write_text("sample,section,thickness_mm\n" + sections)
    depth = np.linspace(-0.1, 0.3, 80)
    write(folder, "ball.csv", depth_mm=depth, force_N=16 / 9 * 3 * np.sqrt(2) * np.maximum(depth, 0) ** 1.5)
    (folder / "ball.yaml").write_text("ball_radius_mm: 2\n")
    return folder


def test_a_folder_with_everything_gives_a_law_and_all_effects(folder, tmp_path):
    characterise("gel", Material(tests=folder, laws=["neo_hooke", "ogden1"]), tmp_path / "out")
    content = json.loads((tmp_path / "out" / "effects.json").read_text())
    assert content["format"] == "gelforge-effects-1"
    by_name = {e["effect"]: e for e in content["effects"]}
    assert set(by_name) == {
        "age", "relaxation", "hysteresis", "softening", "ogden_roxburgh", "friction", "sheet_thickness",
        "microindentation",
    }  # fmt: skip
    assert by_name["age"]["informs"] == ["ageing"]
    low, high = by_name["friction"]["interval_95"]
    assert low < np.tan(np.radians(24.5)) < high
    assert by_name["microindentation"]["value"] == pytest.approx(3.0, rel=0.01)
    law = read_law(tmp_path / "out" / "law.json")
    assert law.samples == {"uniaxial": 9}  # eight loadings and the first one of the cycles
    assert any("averages over the tests' age" in note for note in law.notes)
    assert any("mean of 3 sections in thickness.csv" in note for note in law.notes)
    table = pd.read_csv(tmp_path / "out" / "effects.csv")
    assert set(table.effect[table.verdict == "not judged"]) == {
        "strain_rate",
        "temperature",
        "lateral_contraction",
    }


def test_every_file_of_the_folder_decides_its_results(folder):
    assert {p.name for p in source_files(folder)} == {p.name for p in folder.iterdir()}

    # Thickness from sections that contradicts the table is said
    text = (folder / "samples.csv").read_text().replace("s0_0,10,,", "s0_0,10,0.6,")
    (folder / "samples.csv").write_text(text)
    [gel] = read_sources([folder])
    assert any(
        "thickness_mm 0.6 in samples.csv is used, but its sections" in f for f in gel.tests[0].findings
    )


def small(folder, **files):
    """Return the effects by name of a folder that holds small tests only."""
    folder.mkdir()
    for name, text in files.items():
        stem, _, suffix = name.rpartition("_")
        (folder / f"{stem}.{suffix}").write_text(text)
    [source] = read_sources([folder])
    found = measured_effects(source)
    return {e.effect: e for e in found.effects}, dict(found.not_judged)


def test_tilt_trials_and_sections_alone_are_effects_with_intervals(tmp_path):
    sheets = "sample,section,thickness_mm\n" + "".join(
        f"{name},{k},{h + d}\n"
        for name, h in (("a", 0.5), ("b", 0.52))
        for k, d in enumerate((-0.01, 0, 0.01))
    )
    found, not_judged = small(
        tmp_path / "gel", friction_csv="trial,tilt_deg\na,40\nb,42\nc,41\n", thickness_csv=sheets
    )
    mu, values = found["friction"], np.tan(np.radians([40, 42, 41]))
    assert mu.value == pytest.approx(values.mean())
    # Student's t for two degrees of freedom: 4.303
    assert mu.interval[1] - mu.value == pytest.approx(4.303 * values.std(ddof=1) / np.sqrt(3), rel=1e-3)
    assert f"coefficient is {mu.value:.3f}" in mu.sentence and "3 tilt trials" in mu.sentence
    sheet = found["sheet_thickness"]
    assert sheet.value == pytest.approx(0.51) and sheet.interval_from.endswith("over the samples")
    relative = np.sqrt(np.mean([(0.01 / np.sqrt(3) / h) ** 2 for h in (0.5, 0.52)]))
    assert sheet.parameters["relative_standard_error_of_a_sample"] == pytest.approx(relative, rel=1e-6)
    assert "friction" not in not_judged


def ball_on(give, E=3.0, R=2.0, rest=0.01):
    """Return a press of a ball into a half space on a machine that gives `give` mm per N, as the text of a CSV."""
    d = np.linspace(-0.1, 0.3, 160)
    F = 16 / 9 * E * np.sqrt(R) * np.maximum(d, 0) ** 1.5
    rows = "".join(f"{z:.8g},{f:.8g}\n" for z, f in zip(d + give * F, F + rest))
    return "depth_mm,force_N\n" + rows


def test_the_press_of_a_ball_counts_its_board_and_needs_contact(tmp_path):
    give = 0.05
    z = np.linspace(-0.1, 0.1, 120)
    board = "depth_mm,force_N\n" + "".join(f"{a:.8g},{max(a, 0) / give:.8g}\n" for a in z)
    sidecar = "ball_radius_mm: 2\n"
    alone, _ = small(tmp_path / "alone", ball_csv=ball_on(give), ball_yaml=sidecar)
    assert alone["microindentation"].value < 0.9 * 3.0
    assert "machine's compliance is counted as the specimen's" in alone["microindentation"].sentence
    both, _ = small(
        tmp_path / "both",
        ball_csv=ball_on(give),
        ball_yaml=sidecar + "rigid_board: board.csv\n",
        board_csv=board,
    )
    # 2 %: the touch of the board is found to about one row of 1.7 um, of a depth of 0.3 mm
    assert both["microindentation"].value == pytest.approx(3.0, rel=0.02)
    assert "machine gives" in both["microindentation"].sentence
    # the board decides the result: it belongs to the files whose change makes the material anew
    assert {p.name for p in source_files(tmp_path / "both")} == {"ball.csv", "ball.yaml", "board.csv"}

    # A press without contact is not judged
    z = np.linspace(0, 1, 60)
    text = "depth_mm,force_N\n" + "".join(f"{a:.6g},{a:.6g}\n" for a in z)
    found, not_judged = small(tmp_path / "gel", ball_csv=text, ball_yaml="ball_radius_mm: 2\n")
    assert "microindentation" not in found and "no contact point" in not_judged["microindentation"]


@pytest.mark.thorough
def test_samples_that_went_further_than_others_are_named(folder, tmp_path):
    lam = np.linspace(1, 4, 90)
    write(folder, "far.csv", stretch_1=lam, nominal_stress_kPa=1e3 * virgin(lam))
    with (folder / "samples.csv").open("a") as samples:
        samples.write("far.csv,uniaxial,far,,,,\n")
    characterise("gel", Material(tests=folder, laws=["neo_hooke"]), tmp_path / "out")
    notes = read_law(tmp_path / "out" / "law.json").notes
    assert any("fitted between stretch 1 and 1.8, where all 10 samples" in note for note in notes)


@pytest.mark.thorough
def test_a_ramp_is_fitted_where_there_is_nothing_else_and_ends_before_it_relaxes(tmp_path):
    result = characterise_source(
        MaterialSource("gel", (held("a"), held("b"))), Fitting(laws=["neo_hooke"]), tmp_path
    )
    assert result.comparison.chosen.fit.valid_stretch["uniaxial"][1] == pytest.approx(1.5, abs=0.02)
    assert result.comparison.chosen.fit.r2_nominal["uniaxial"] > 0.999
    assert any("of the relaxation test only the first loading" in note for note in result.notes)


def test_small_tests_alone_need_no_law_by_hand_but_a_study_does(folder, tmp_path):
    result = characterise_source(
        read_sources([folder / "friction.csv"])[0], Fitting(), tmp_path / "out", law_needed=False
    )
    assert result.comparison is None and "no constitutive model is fitted" in result.summary
    assert not (tmp_path / "out" / "law.json").exists()
    for name in ("samples.csv", *(p.name for p in folder.glob("u*.csv"))):
        (folder / name).unlink()
    with pytest.raises(FitError, match="gel: no loading to fit a constitutive model to"):
        characterise("gel", Material(tests=folder), tmp_path / "study")


def test_a_study_takes_its_material_from_a_mapped_folder(tmp_path):
    lam = np.linspace(1, 2, 30)
    for material in ("soft", "hard"):
        factor = 1 if material == "soft" else 3
        write(tmp_path, f"{material}.csv", stretch=lam, stress=factor * 20 * (lam - lam**-2))
    mapping = tmp_path.with_suffix(".yaml")
    mapping.write_text(
        "describes: strips\ntests:\n  - files: ['*.csv']\n    kind: uniaxial\n"
        "    strain: {column: stretch, measure: stretch}\n"
        "    stress: {column: stress, unit: kPa, measure: nominal}\n"
        "    from_name: {pattern: '(?P<material>[a-z]+)'}\n"
    )
    assert source_of("hard", tmp_path, mapping).files[-1] == mapping
    with pytest.raises(TableError, match=r"holds the materials \['hard', 'soft'\], none is called 'gel'"):
        source_of("gel", tmp_path, mapping)
    characterise("hard", Material(tests=tmp_path, mapping=mapping, laws=["neo_hooke"]), tmp_path / "out")
    assert read_law(tmp_path / "out" / "law.json").law.mu == pytest.approx(0.06, rel=1e-6)


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("choose", ["aicc", "held_out", "first"])
def test_the_chosen_law_is_the_one_asked_for(folder, tmp_path, choose):
    fitting = Fitting(laws=["ogden1", "neo_hooke", "yeoh"], choose=choose)
    result = characterise_source(read_sources([folder])[0], fitting, tmp_path / "out")
    comparison = result.comparison
    if choose == "first":
        assert comparison.chosen.name == "ogden1" and "chosen as the first named" in comparison.reason
    else:
        assert comparison.chosen.aicc == min(c.aicc for c in comparison.candidates)
    assert {p.stem for p in (tmp_path / "out" / "laws").iterdir()} == {"ogden1", "neo_hooke", "yeoh"} - {
        comparison.chosen.name
    }
