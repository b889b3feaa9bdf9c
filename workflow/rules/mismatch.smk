"""Where simulation and recordings differ, and which physics was left out."""

SLOPE_SOURCES = [
    f"mismatch/{name}.py"
    for name in (
        *("model/solver_effects", "model/places", "evidence/candidates"),
        *("fem/site_slopes", "fem/stored", "fem/solutions", "fem/solver"),
    )
]
LOOKED_AT = [] if STUDY.mismatch.images == "left_out" else ["reference.png", "images"]


SLOPES = [name for name, cell in CELLS.items() if cell.solved]


def slope_files():
    return expand(f"{RESULTS}/sensitivities/{{cell}}.h5", cell=SLOPES)


rule site_sensitivities:
    """The derivatives of one site's forces along all that a verdict may ask for, on its coarser mesh."""
    input:
        laws=law_files(),
        indenter=indenter_files(),
    output:
        ensure(f"{RESULTS}/sensitivities/{{cell}}.h5", non_empty=True),
    log:
        f"{LOGS}/sensitivities/{{cell}}.log",
    benchmark:
        f"{BENCHMARKS}/sensitivities/{{cell}}.tsv"
    wildcard_constraints:
        cell=any_of(SLOPES),
    group:
        "fem"
    threads: 1
    resources:
        cpu_ms=counts(cell_seconds),
        runtime=asks(cell_seconds),
        mem_mb=1500,
    params:
        planned=planned,
        model=block("sensor", "indenter", "mechanics"),
        tried=[STUDY.mismatch.coarser, STUDY.mismatch.leave_out],
        source=source_digest("mechanics", "meshing", "indentation", "mismatch/effects", *SLOPE_SOURCES),
    shell:
        "{ONE_THREAD:q} {GELFORGE:q} sensitivities --study {STUDY_FILE:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --out {output:q} &> {log:q}"


rule sensitivities:
    """The derivatives of all solved sites."""
    input:
        slope_files(),


rule mismatch:
    """The verdict on all sessions together, with its page and the keys that would put the answer into the study."""
    input:
        laws=law_files(),
        cells=cell_files(CELLS),
        sensitivities=slope_files() if STUDY.stores_sensitivities else [],
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
