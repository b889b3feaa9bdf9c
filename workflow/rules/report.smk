"""One offline page with every figure."""


rule report:
    """The study at a glance, from files that the other rules made."""
    input:
        plan=f"{RESULTS}/plan.csv",
        laws=law_files(),
        curves=expand(f"{RESULTS}/materials/{{material}}/curves.csv", material=STUDY.materials),
        cells=cell_files(CELLS),
        manifest=f"{RESULTS}/dataset/manifest.json",
        tables=table_files(),
        agreement=f"{RESULTS}/agreement.csv" if STUDY.sessions else [],
        predictions=f"{RESULTS}/model/predictions.h5" if IMAGE_SESSIONS else [],
    output:
        ensure(f"{RESULTS}/report.html", non_empty=True),
    log:
        f"{LOGS}/report.log",
    benchmark:
        f"{BENCHMARKS}/report.tsv"
    params:
        source=source_digest("report"),
    shell:
        "{GELFORGE} report --study {STUDY_FILE} --out {output} &> {log}"
