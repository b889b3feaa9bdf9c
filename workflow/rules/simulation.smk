"""The plan and its cells: one position with all its depths is one job and one file."""


rule study:
    """The study as it was understood, every default written out."""
    output:
        ensure(f"{RESULTS}/study.yaml", non_empty=True),
    log:
        f"{LOGS}/study.log",
    params:
        study=digest(STUDY.model_dump(mode="json")),
    shell:
        "cp {STUDY_FILE:q} {output:q} 2> {log:q}"


rule plan:
    """The plan as a table."""
    output:
        ensure(f"{RESULTS}/plan.csv", non_empty=True),
    log:
        f"{LOGS}/plan.log",
    params:
        cells=block("plan", "sensor", "indenter"),
    shell:
        "{GELFORGE:q} plan --study {STUDY_FILE:q} --out {output:q} &> {log:q}"


rule simulate:
    """Press at one position, depth by depth; a cell that fails is a file that says so."""
    input:
        laws=law_files(),
        mirrored=mirrored_cell,
        indenter=indenter_files(),
    output:
        ensure(f"{RESULTS}/cells/{{cell}}.h5", non_empty=True),
    log:
        f"{LOGS}/cells/{{cell}}.log",
    benchmark:
        f"{BENCHMARKS}/cells/{{cell}}.tsv"
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
        source=source_digest("mechanics", "meshing", "indentation"),
    shell:
        "{ONE_THREAD:q} {SOLVE:q} simulate --study {STUDY_FILE:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --mirrored {input.mirrored:q} --out {output:q} &> {log:q}"


rule variant:
    """Press at one position under the other assumptions of a variant; the report shows it beside the study's own."""
    input:
        laws=law_files(),
    output:
        ensure(f"{RESULTS}/variants/{{variant}}/{{cell}}.h5", non_empty=True),
    log:
        f"{LOGS}/variants/{{variant}}/{{cell}}.log",
    benchmark:
        f"{BENCHMARKS}/variants/{{variant}}/{{cell}}.tsv"
    group:
        "fem"
    threads: 1
    resources:
        cpu_ms=counts(variant_seconds),
        runtime=asks(variant_seconds),
        mem_mb=1500,
    params:
        planned=lambda wildcards: planned(wildcards)[:3],
        model=lambda wildcards: block(
            "sensor", "indenter", "mechanics", study=variant_study(STUDY, wildcards.variant)
        ),
        source=source_digest("mechanics", "indentation"),
    shell:
        "{ONE_THREAD:q} {SOLVE:q} simulate --study {STUDY_FILE:q} --variant {wildcards.variant:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --out {output:q} &> {log:q}"


rule session_cell:
    """Press at one position as the sensor was in a session that states another age or temperature than the study."""
    input:
        laws=law_files(),
        mirrored=mirrored_session_cell,
        indenter=indenter_files(),
    output:
        ensure(f"{RESULTS}/sessions/{{session}}/cells/{{cell}}.h5", non_empty=True),
    log:
        f"{LOGS}/sessions/{{session}}/cells/{{cell}}.log",
    benchmark:
        f"{BENCHMARKS}/sessions/{{session}}/cells/{{cell}}.tsv"
    group:
        "fem"
    threads: 1
    resources:
        cpu_ms=counts(cell_seconds),
        runtime=asks(cell_seconds),
        mem_mb=1500,
    params:
        planned=planned,
        model=lambda wildcards: block(
            "sensor", "indenter", "mechanics", study=SESSION_STUDIES[wildcards.session]
        ),
        source=source_digest("mechanics", "meshing", "indentation"),
    shell:
        "{ONE_THREAD:q} {SOLVE:q} simulate --study {STUDY_FILE:q} --session {wildcards.session:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --mirrored {input.mirrored:q} --out {output:q} &> {log:q}"


rule session_presses:
    """Follow a session's presses in recorded order on one sensor that softens; goes on where it was broken off."""
    input:
        laws=law_files(),
        readings=f"{RESULTS}/recordings/{{session}}.csv",
        indenter=indenter_files(),
    output:
        ensure(f"{RESULTS}/sessions/{{session}}/presses.h5", non_empty=True),
    log:
        f"{LOGS}/sessions/{{session}}/presses.log",
    benchmark:
        f"{BENCHMARKS}/sessions/{{session}}/presses.tsv"
    threads: 1
    resources:
        runtime=asks(presses_seconds),
        mem_mb=1500,
    params:
        model=lambda wildcards: block(
            "sensor", "indenter", "mechanics", "plan", study=SESSION_STUDIES[wildcards.session]
        ),
        source=source_digest(
            "mechanics",
            "meshing",
            "indentation",
            "dataset/presses_in_order.py",
            "dataset/recorded_presses.py",
            "dataset/session_labels.py",
        ),
    shell:
        "{ONE_THREAD:q} {GELFORGE:q} simulate-session --study {STUDY_FILE:q} --session {wildcards.session:q}"
        " --laws {input.laws:q} --out {output:q} &> {log:q}"


rule cells:
    """Every cell of the plan, and those of sessions."""
    input:
        cell_files(CELLS),
        session_label_files(CELLS),
