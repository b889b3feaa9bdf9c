"""Jobs of what a study found: its tables and its page."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import agreement_inputs, image_sessions, own_laws, session_of, shard_paths
from gelforge.config import load_study

# The study whose report shows the article's numbers, and where they are.
ARTICLES_STUDY, ARTICLES_NUMBERS = "paper", Path("data/paper")


def tables(study: Path) -> None:
    """Write the article's tables from laws, agreement and predictions; the labels' ranges where nothing is predicted."""
    from gelforge.dataset.agreement import read_agreement, rmse_gt_table
    from gelforge.dataset.ranges import force_ranges_table, label_ranges
    from gelforge.files import digest, write_table
    from gelforge.materials.fitting.material_table import material_table

    described = load_study(study)
    results, folder = described.results_folder, described.results_folder / "tables"
    laws = own_laws(described)
    write_table(folder, "material", material_table(laws))
    if described.sessions:
        resolution = {name: session_of(described, name).force.resolution_N for name in described.sessions}
        inputs = digest(list(agreement_inputs(described, {law.material: law.law for law in laws})))
        agreed = read_agreement(results / "agreement.csv", inputs)
        write_table(folder, "rmse_gt", rmse_gt_table(agreed, resolution))
    if image_sessions(described):
        from gelforge.learning.judging import evaluation
        from gelforge.learning.judging.error_budget import error_budget_table
        from gelforge.learning.judging.predictions import Predictions  # labels alone need no PyTorch

        predictions = Predictions(results / "model" / "predictions.h5")
        predictions.check_model(results / "model" / "model.pt")
        write_table(folder, "rmse", evaluation.rmse_table(predictions))
        write_table(folder, "baselines", evaluation.baselines_table(predictions))
        write_table(folder, "errors_by", evaluation.errors_by_table(predictions))
        write_table(folder, "reliability", evaluation.reliability_table(predictions))
        budget = error_budget_table(predictions)
        if budget is not None:
            write_table(folder, "error_budget", budget)
        else:  # none of earlier predictions is left next to these
            for suffix in ("csv", "md"):
                (folder / f"error_budget.{suffix}").unlink(missing_ok=True)
            if described.virtual_lab is not None:
                print(f"no error budget: {predictions.path} holds no truth; evaluate the model again")
        ranges = predictions.label_range
    else:
        ranges = label_ranges(shard_paths(described))
    write_table(folder, "force_ranges", force_ranges_table(ranges))


def report(study: Path, out: Path) -> None:
    """Write the study's offline page, and say what it had to leave out."""
    from gelforge.report.page import write_report

    described = load_study(study)
    article = ARTICLES_NUMBERS if described.study == ARTICLES_STUDY else None
    for words in write_report(described, described.results_folder, out, article):
        print(words)
