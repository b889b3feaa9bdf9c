from snakemake.utils import min_version

min_version("9.27")

# `--configfile FILE` names another study; it replaces the demo instead of being merged into it.
if "study" not in config:

    configfile: "config/config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/cluster.smk"
include: "workflow/rules/material.smk"
include: "workflow/rules/simulation.smk"
include: "workflow/rules/virtual.smk"
include: "workflow/rules/recording.smk"
include: "workflow/rules/dataset.smk"
include: "workflow/rules/learning.smk"
include: "workflow/rules/mismatch.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/resume.smk"


localrules:  # seconds each: not worth a job of a cluster
    study,
    plan,
    readings,
    manifest,
    agreement,
    tables,


onstart:
    check_paths(list(workflow.dag.needrun_jobs()))
    check_raw_data(list(workflow.dag.needrun_jobs()))
    solve_anew(list(workflow.dag.needrun_jobs()))
    begin_solving(list(workflow.dag.needrun_jobs()))


onsuccess:
    tidy_up()


rule all:
    """Everything that the study can make; the cells too, so that a deleted one is made again."""
    default_target: True
    input:
        f"{RESULTS}/study.yaml",
        f"{RESULTS}/plan.csv",
        cell_files(CELLS),
        session_label_files(CELLS),
        slope_files() if STUDY.stores_sensitivities else [],
        f"{RESULTS}/dataset/manifest.json",
        *table_files(),
        f"{RESULTS}/model/model.pt" if ONLY_SIMULATED else [],
        f"{RESULTS}/report.html",
