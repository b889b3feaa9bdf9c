"""One offline page with every figure."""


rule report:
    """The study at a glance, from files that the other rules made."""
    input:
        plan=f"{RESULTS}/plan.csv",
        laws=law_files(),
        materials=expand(
            f"{RESULTS}/materials/{{material}}/{{name}}",
            material=STUDY.materials,
            name=["curves.csv", "effects.json", "effects.csv", "laws.csv", "parameters.csv", "laws"],
        ),
        cells=cell_files(CELLS),
        variants=variant_files(),
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
        variants=block("variants"),
        source=source_digest("report"),
    shell:
        "{GELFORGE} report --study {STUDY_FILE} --out {output} &> {log}"
