"""Commands that train a network, ask it about held-out sites, and adapt it to another sensor."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import shard_paths, truth_folder, virtual_lab_of
from gelforge.config import Study, load_study
from gelforge.progress import Stages, stage


def train(study: Path, model: Path, loss: Path) -> None:
    """Train the study's network, or go on from its checkpoint."""
    from gelforge.dataset.manifest import check_shards
    from gelforge.learning.basis.memory import memory_named
    from gelforge.learning.training.train import train

    described = load_study(study)
    sets = learning_sets(described)
    if set(sets.learnt) & set(sets.tested):
        check_shards(shard_paths(described), described.results_folder / "dataset" / "manifest.json")
    with memory_named(more_memory("train", described)), Stages("training"):
        stage("inverse elasticity")
        inverse = inverse_elasticity(described, sets.learnt)
        stage("the network")
        train(described, sets.learnt, model, loss, inverse=inverse)


def inverse_elasticity(study: Study, shards: list[Path]):
    """Return the inverse elasticity of a study's sensor and camera; None where it is not known, and say why."""
    from gelforge.laws_of_study import known_laws
    from gelforge.learning.elasticity.of_study import NoOperator, inverse_of
    from gelforge.learning.models.views import views_of

    laws = {name: material.law for name, material in known_laws(study, []).items()}
    try:
        return inverse_of(study, laws, views_of(shards))
    except NoOperator as error:
        print(f"no inverse elasticity: {error}")
        return None


def evaluate(study: Path, model: Path, out: Path) -> None:
    """Write the predictions of every row of the held-out cells."""
    from gelforge.learning.basis.memory import memory_named
    from gelforge.learning.judging.predictions import predict_test_rows
    from gelforge.learning.models.model_file import check_trained_on
    from gelforge.learning.training.train import model_settings

    described = load_study(study)
    sets = learning_sets(described)
    check_trained_on(model, model_settings(described, sets.learnt))
    with memory_named(more_memory("evaluate", described)):
        rows = predict_test_rows(model, sets, described, out, truth=known_truth(described, study))
    print(f"{rows} rows of held-out cells")


def more_memory(rule: str, study: Study) -> str:
    """Return what to do where a job of the network runs out of memory."""
    learning = study.learning.usual
    width = "hidden" if learning.network == "paper" else "channels"
    return (
        f"give the job more (end other programs; on a cluster --set-resources {rule}:mem_mb=8000), or set a smaller "
        f"learning.batch_size (now {learning.batch_size}) or learning.{width} (now {getattr(learning, width)})"
    )


def adapt(study: Path, model: Path, presses: int, seed: int, out: Path) -> None:
    """Fit a model's gains to a few recorded presses of another sensor; print its errors on test rows before and after."""
    from gelforge.dataset.shard import ShardDataset
    from gelforge.learning.models.model_file import load_model, save_model
    from gelforge.learning.models.views import check_same_images, views_of
    from gelforge.learning.training import adaptation

    described = load_study(study)
    shards = shard_paths(described)
    with Stages("adaptation"):
        stage("rows with measured forces")
        before = load_model(model)
        check_same_images(before, described.features.regions, views_of(shards))
        learnt, tested = (ShardDataset(shards, split) for split in ("train", "test"))
        names = adaptation.press_names(learnt)
        drawn = adaptation.measured_presses(learnt, names, adaptation.drawn_presses(names, presses, seed))
        stage("gains, chosen on presses left out")
        after, found = adaptation.adapt(before, drawn)
        save_model(out, after)
        stage("errors on held-out sites")
        held_out = adaptation.measured_presses(tested, adaptation.press_names(tested))
        table = adaptation.errors_table({"as trained": before, "adapted": after}, held_out)
    gains = ", ".join(f"{axis} {value:.3f}" for axis, value in zip("xyz", found.gain))
    print(
        f"{presses} presses: {found.form}, gains {gains}; intervals of totals times "
        f"{', '.join(f'{value:.2f}' for value in found.widened)}"
    )
    for form, error in found.left_out_N.items():
        print(f"  {form}: {1e3 * error:.1f} mN on presses left out")
    if len(held_out.press):
        print(f"\nTotal force against the force sensor on {len(held_out.press)} rows of held-out sites:\n")
        print(table.to_markdown(index=False, floatfmt=".4f"))
    else:
        print("\nno held-out row with a measured force: errors before and after are not known")
    print(f"\nwritten to {out}")


def known_truth(study: Study, path: Path):
    """Return the truth of the study's recordings where a virtual lab made them and its files are there, or say why not."""
    from functools import partial

    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.learning.judging.true_motion import Truth
    from gelforge.recording.optics.camera import mm_per_px_at
    from gelforge.virtual_lab.particles import mean_height
    from gelforge.virtual_lab.session import session_cells
    from gelforge.virtual_lab.true_presses import true_presses

    if study.virtual_lab is None:
        return None
    lab, cells, folder = virtual_lab_of(study, path), plan_cells(study), truth_folder(study)
    shared_out = session_cells(lab, cells)
    pressed = [cells[name] for session in study.sessions for name in shared_out.get(session, [])]
    moving = next((cell.name for cell in pressed if cell.follows_a_path), None)
    if moving is not None:
        print(f"no error budget: it is made of straight presses, and cell {moving} follows a path")
        return None
    needed = {folder / f"{cell.source or cell.name}.h5" for cell in pressed}
    missing = sorted(file.name for file in needed if not file.is_file())
    if missing:
        print(
            f"no error budget: {folder} lacks {len(missing)} of {len(needed)} cells, the first {missing[0]} "
            "(gelforge virtual-cell makes one)"
        )
        return None
    middle_mm = mean_height(lab.particles, study.sensor)
    return Truth(partial(true_presses, study, lab, cells, folder), mm_per_px_at(lab.camera, middle_mm))


def synthetic_paths(study: Study) -> list[Path]:
    """Return the files of the study's simulated training set."""
    from gelforge.synthesis.draws import shard_count

    count = shard_count(study) if study.synthesis else 0
    return [study.results_folder / "synthetic" / f"{number:05d}.h5" for number in range(count)]


def learning_sets(study: Study):
    """Return the shards that the study's network learns from and those that test it."""
    from gelforge.learning.judging.predictions import LearningSets

    recorded, simulated = shard_paths(study), synthetic_paths(study)
    if study.synthesis and study.synthesis.train_on == "simulated":
        return LearningSets(simulated, recorded, None)
    return LearningSets([*simulated, *recorded], recorded)
