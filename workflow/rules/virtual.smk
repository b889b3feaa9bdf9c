"""SYNTHETIC recordings: sensors whose true physics is known. Only studies with `virtual_lab` have these rules."""

if LAB:

    rule virtual_cell:
        """Press the virtual sensor at one position: true constitutive models, a mesh of its own, loading and unloading."""
        input:
            lab=ancient(STUDY.virtual_lab.as_posix()),
        output:
            ensure(f"{TRUTH}/{{cell}}.h5", non_empty=True),
        log:
            f"{LOGS}/virtual_truth/{{cell}}.log",
        benchmark:
            f"{BENCHMARKS}/virtual_truth/{{cell}}.tsv"
        group:
            "fem"
        threads: 1
        resources:
            cpu_ms=counts(true_seconds),
            runtime=asks(true_seconds),
            mem_mb=1500,
        params:
            planned=planned,
            model=block("sensor", "indenter"),
            truth=lab_block("mechanics", "materials", "stiffness_scale", "unload_depths_mm"),
            source=source_digest("mechanics", "meshing", "indentation"),
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} virtual-cell --study {STUDY_FILE:q} --cell {wildcards.cell:q} --out {output:q} &> {log:q}"

    rule virtual_session:
        """Record one synthetic session from the truth, which only the error budget reads too."""
        input:
            lab=ancient(STUDY.virtual_lab.as_posix()),
            truth=true_cells,
        output:
            f"{DATA}/recordings/{{session}}/session.yaml",
            f"{DATA}/recordings/{{session}}/indentations.csv",
            f"{DATA}/recordings/{{session}}/reference.png",
            images=directory(f"{DATA}/recordings/{{session}}/images"),
        log:
            f"{LOGS}/virtual_sessions/{{session}}.log",
        benchmark:
            f"{BENCHMARKS}/virtual_sessions/{{session}}.tsv"
        threads: 2
        resources:
            runtime=asks(drawing_seconds),
            mem_mb=1500,
        params:
            model=block("sensor", "plan"),
            lab=digest(LAB.model_dump(mode="json")),
            source=source_digest("virtual_lab"),
        shell:
            "{GELFORGE:q} virtual-session --study {STUDY_FILE:q} --session {wildcards.session:q}"
            " --workers {threads:q} &> {log:q}"
