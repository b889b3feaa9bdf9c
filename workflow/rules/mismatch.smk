"""Where simulation and recordings differ, and which physics was left out."""

LOOKED_AT = [] if STUDY.mismatch.images == "left_out" else ["reference.png", "images"]


rule mismatch:
    """The verdict on all sessions together, with its page and the keys that would put the answer into the study."""
    input:
        laws=law_files(),
        cells=cell_files(CELLS),
        readings=[f"{RESULTS}/recordings/{session}.csv" for session in STUDY.sessions],
        sessions=[
            name
            for session in STUDY.sessions
            for name in session_files(session, "session.yaml", "indentations.csv", *LOOKED_AT)
        ],
    output:
        verdict=f"{RESULTS}/mismatch/verdict.json",
        readings=f"{RESULTS}/mismatch/readings.csv",
        page=f"{RESULTS}/mismatch/report.html",
    log:
        f"{LOGS}/mismatch.log",
    benchmark:
        f"{BENCHMARKS}/mismatch.tsv"
    threads: 2
    resources:
        runtime=asks(verdict_seconds),
    params:
        study=block("sensor", "indenter", "mechanics", "mismatch", "seed"),
        source=source_digest("mechanics", "indentation", "recording", "mismatch", "report/mismatch_page.py"),
    shell:
        "{ONE_THREAD:q} {GELFORGE:q} mismatch {DATA:q} --config {STUDY_FILE:q} --out {RESULTS:q}/mismatch"
        " --workers {threads:q} &> {log:q}"


rule paper_mismatch:
    """The article's own readings against its two published curves and against our cells; needs no study of yours."""
    input:
        study="config/paper.yaml",
        table="data/paper/force_depth.csv",
    output:
        "results/paper_mismatch/summary.md",
        expand("results/paper_mismatch/{case}/report.html", case=("linear", "hyperelastic", "cells")),
    log:
        "logs/paper_mismatch.log",
    threads: 2
    resources:
        runtime=asks(lambda *_: PAPER_S),
    params:
        source=source_digest("mechanics", "indentation", "mismatch", "report/mismatch_page.py"),
    shell:
        "{ONE_THREAD:q} {GELFORGE:q} mismatch-published --config {input.study:q} --out results/paper_mismatch"
        " --workers {threads:q} &> {log:q}"
