"""The plan and its cells: one position with all its depths is one file, and one job where it is solved.

Cells that mirror others, or lie between solved sites (plan.interpolation), are made in bulk.
"""


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
        planned=digest([[name, *planned_cell(cell)] for name, cell in CELLS.items()]),
    shell:
        "{GELFORGE:q} plan --study {STUDY_FILE:q} --out {output:q} &> {log:q}"


rule simulate:
    """Press at one position, depth by depth; a site that fails is a file that says so."""
    input:
        laws=law_files(),
        indenter=indenter_files(),
    output:
        ensure(f"{RESULTS}/cells/{{cell}}.h5", non_empty=True),
    log:
        f"{LOGS}/cells/{{cell}}.log",
    benchmark:
        f"{BENCHMARKS}/cells/{{cell}}.tsv"
    wildcard_constraints:
        cell=any_of(name for name, cell in CELLS.items() if cell.solved),
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
        "{ONE_THREAD:q} {GELFORGE:q} simulate --study {STUDY_FILE:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --out {output:q} &> {log:q}"


if BETWEEN:

    rule solve_site:
        """Press at one of the places between which labels are interpolated; its forces are stored as a site's."""
        input:
            laws=law_files(),
            indenter=indenter_files(),
        output:
            ensure(f"{SITES}/{{site}}.h5", non_empty=True),
        log:
            f"{LOGS}/solved_sites/{{site}}.log",
        benchmark:
            f"{BENCHMARKS}/solved_sites/{{site}}.tsv"
        group:
            "fem"
        threads: 1
        resources:
            cpu_ms=counts(site_seconds),
            runtime=asks(site_seconds),
            mem_mb=1500,
        params:
            planned=planned_site,
            model=block("sensor", "indenter", "mechanics"),
            source=source_digest("mechanics", "meshing", "indentation"),
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} simulate --study {STUDY_FILE:q} --cell {wildcards.site:q} --between"
            " --laws {input.laws:q} --out {output:q} &> {log:q}"

    checkpoint level:
        """Decide which sites of the next level are solved, from what those of this one and before predict of each other.

        The jobs of a level are known when the level before is decided; the last one's decision asks for none.
        """
        input:
            laws=law_files(),
            solved=sites_of_level,
        output:
            ensure(f"{RESULTS}/interpolation/level_{{level}}.json", non_empty=True),
        log:
            f"{LOGS}/interpolation/level_{{level}}.log",
        localrule: True
        params:
            between=CELLS[BETWEEN[0]].between,
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} level --study {STUDY_FILE:q} --level {wildcards.level:q} --laws {input.laws:q}"
            " --out {output:q} &> {log:q}"


for number, names in DERIVED.items():

    rule:
        name:
            f"derive_{number}"
        # The sites of one job that mirror solved ones or lie between them (gelforge/indentation/planning/derived.py).
        input:
            laws=law_files(),
            sources=lambda wildcards, names=names: derived_sources(names),
        output:
            [ensure(path, non_empty=True) for path in cell_files(names)],
        log:
            f"{LOGS}/cells/derive_{number}.log",
        benchmark:
            f"{BENCHMARKS}/derived/{number}.tsv"
        localrule: True
        params:
            number=number,
            planned=[planned_cell(CELLS[name]) for name in names],
            model=block("sensor", "indenter", "mechanics"),
            source=source_digest("mechanics", "meshing", "indentation"),
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} derive --study {STUDY_FILE:q} --number {params.number:q} --laws {input.laws:q}"
            " &> {log:q}"


rule variant:
    """Press at one position under the other assumptions of a variant; the report shows it next to the study's own."""
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
        "{ONE_THREAD:q} {GELFORGE:q} simulate --study {STUDY_FILE:q} --variant {wildcards.variant:q} --cell {wildcards.cell:q}"
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
        "{ONE_THREAD:q} {GELFORGE:q} simulate --study {STUDY_FILE:q} --session {wildcards.session:q} --cell {wildcards.cell:q}"
        " --laws {input.laws:q} --out {output:q} &> {log:q}"


rule session_presses:
    """Follow a session's indentations in recorded order on one sensor that softens; continues where it was interrupted."""
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
    """Every site of the plan, and those of sessions."""
    input:
        cell_files(CELLS),
        session_label_files(CELLS),
