"""One offline page with every figure, and the table that says how far the finite elements are to be trusted."""


rule verify:
    """The finite elements against independent reference solutions: one table for all studies, unless one asks for parts."""
    output:
        expand(f"{RESULTS}/tables/verification.{{suffix}}", suffix=("csv", "md")),
    log:
        f"{LOGS}/verify.log",
    benchmark:
        f"{BENCHMARKS}/verify.tsv"
    priority: -1  # it fills the core that training leaves idle
    threads: 1
    resources:
        runtime=asks(lambda *_: VERIFY_S),
    params:
        only=["--only", *STUDY.verification] if STUDY.verification else [],
        source=source_digest("mechanics", "verification"),
    shell:
        "{ONE_THREAD:q} {GELFORGE:q} verify --out {RESULTS:q}/tables {params.only:q} &> {log:q}"


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
        verification=f"{RESULTS}/tables/verification.csv" if STUDY.verifies else [],
        agreement=f"{RESULTS}/agreement.csv" if STUDY.sessions else [],
        findings=expand(f"{RESULTS}/recordings/{{session}}.findings.csv", session=STUDY.sessions),
        predictions=f"{RESULTS}/model/predictions.h5" if IMAGE_SESSIONS else [],
        onnx_check=ONNX_CHECK if STUDY.learning.onnx and IMAGE_SESSIONS else [],
        mismatch=f"{RESULTS}/mismatch/report.html" if STUDY.judges else [],
    output:
        page=ensure(f"{RESULTS}/report.html", non_empty=True),
        checks=[f"{RESULTS}/verification.html"] if STUDY.verifies else [],
    log:
        f"{LOGS}/report.log",
    benchmark:
        f"{BENCHMARKS}/report.tsv"
    resources:
        runtime=asks(short_seconds),
    params:
        variants=block("variants"),
        source=source_digest("report", "mismatch/result/verdict.py"),
    shell:
        "{GELFORGE:q} report --study {STUDY_FILE:q} --out {output.page:q} &> {log:q}"
