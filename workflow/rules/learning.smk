"""Training, prediction of the held-out sites, and the article's tables from what was saved."""

if SYNTHETIC:

    rule solve_synthesis:
        """Press a simulated sensor at a site or along a drawn path, and keep how the gel moves."""
        input:
            laws=law_files(),
            surfaces=[str(file) for file in STUDY.synthesis.shapes.files] + indenter_files(),
        output:
            ensure(f"{RESULTS}/synthetic/solved/{{number}}.h5", non_empty=True),
        log:
            f"{LOGS}/synthetic/solved/{{number}}.log",
        benchmark:
            f"{BENCHMARKS}/synthetic/solved/{{number}}.tsv"
        group:
            "fem"
        threads: 1
        resources:
            cpu_ms=counts(solution_seconds),
            runtime=asks(solution_seconds),
            mem_mb=1500,
        params:
            solved=solved_settings,
            source=source_digest("mechanics", "meshing", "indentation", "synthesis/draws.py"),
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} solve-synthesis --study {STUDY_FILE:q} --number {wildcards.number:q}"
            " --laws {input.laws:q} --out {output:q} &> {log:q}"

    rule synthesise:
        """Draw training rows from the solved presses: features of the images that the sensor would show, and forces."""
        input:
            SOLVED_PRESSES,
        output:
            ensure(f"{RESULTS}/synthetic/{{number}}.h5", non_empty=True),
        log:
            f"{LOGS}/synthetic/{{number}}.log",
        benchmark:
            f"{BENCHMARKS}/synthetic/{{number}}.tsv"
        threads: 1
        resources:
            cpu_ms=counts(synthetic_seconds),
            runtime=asks(synthetic_seconds),
            mem_mb=2000,
        params:
            drawn=drawn_settings,
            source=source_digest(
                *(
                    "recording",
                    "virtual_lab",
                    "synthesis",
                    "interpolation",
                    "dataset/shard.py",
                    "dataset/schema.py",
                )
            ),
        shell:
            "{ONE_THREAD:q} {GELFORGE:q} synthesise --study {STUDY_FILE:q} --number {wildcards.number:q}"
            " --solved {input:q} --out {output:q} &> {log:q}"


rule train:
    """Train the network; an interrupted training goes on from its last checkpoint."""
    input:
        manifest=[] if ONLY_SIMULATED else f"{RESULTS}/dataset/manifest.json",
        shards=[] if ONLY_SIMULATED else expand(f"{RESULTS}/dataset/shard-{{shard}}.h5", shard=SHARDS),
        simulated=SYNTHETIC,
        laws=law_files(),
    output:
        model=ensure(f"{RESULTS}/model/model.pt", non_empty=True),
        loss=ensure(f"{RESULTS}/model/loss.csv", non_empty=True),
    log:
        f"{LOGS}/model/train.log",
    benchmark:
        f"{BENCHMARKS}/train.tsv"
    threads: 2 if STUDY.learning.network == "paper" else 1
    resources:
        runtime=asks(training_seconds),
        mem_mb=4000,
    params:
        learning=digest(STUDY.training_settings),
        simulated=ONLY_SIMULATED,
        source=source_digest(
            *(f"learning/basis/{name}.py" for name in ("data", "network", "scaling", "turns")),
            *(
                "learning/networks",
                "learning/elasticity",
                "learning/training/optimiser.py",
                "learning/training/train.py",
                "learning/models/model_file.py",
                "learning/models/reliability.py",
                "config/parts/learning.py",
            ),
            *("dataset/splits.py", "indentation/sensor/symmetry.py"),
        ),
    shell:
        "{GELFORGE:q} train --study {STUDY_FILE:q} --model {output.model:q} --loss {output.loss:q} &> {log:q}"


rule evaluate:
    """Predict every row of the held-out sites and keep the predictions, with the truth where a virtual lab knows it."""
    input:
        model=f"{RESULTS}/model/model.pt",
        shards=expand(f"{RESULTS}/dataset/shard-{{shard}}.h5", shard=SHARDS),
        simulated=SYNTHETIC,
        truth=recorded_truth,
    output:
        ensure(f"{RESULTS}/model/predictions.h5", non_empty=True),
    log:
        f"{LOGS}/model/evaluate.log",
    benchmark:
        f"{BENCHMARKS}/evaluate.tsv"
    threads: 2
    resources:
        runtime=asks(evaluation_seconds),
        mem_mb=2000,
    params:
        source=source_digest(
            *(f"learning/models/{name}.py" for name in ("model_file", "reliability")),
            "learning/elasticity",
            *(f"learning/judging/{name}.py" for name in ("baselines", "predictions", "true_motion")),
            *(f"learning/basis/{name}.py" for name in ("data", "network", "scaling")),
            "learning/networks",
            "dataset/splits.py",
        ),
        lab=[digest(LAB.model_dump(mode="json")), source_digest("virtual_lab", "recording")] if LAB else [],
    shell:
        "{GELFORGE:q} evaluate --study {STUDY_FILE:q} --model {input.model:q} --out {output:q} &> {log:q}"


if STUDY.learning.onnx:

    rule export:
        """The trained model for ONNX Runtime, written where every output equals PyTorch's."""
        input:
            f"{RESULTS}/model/model.pt",
        output:
            ensure(f"{RESULTS}/model/model.onnx", non_empty=True),
        log:
            f"{LOGS}/model/export.log",
        benchmark:
            f"{BENCHMARKS}/export.tsv"
        resources:
            runtime=asks(short_seconds),
            mem_mb=2000,
        params:
            source=source_digest(
                *(f"learning/deployment/{name}.py" for name in ("equality", "onnx_export", "onnx_model")),
                *("learning/models", "learning/networks", "learning/basis", "learning/elasticity"),
            ),
        shell:
            "{GELFORGE:q} export --model {input:q} --out {output:q} &> {log:q}"

    rule onnx_check:
        """Forces of held-out images by ONNX Runtime, from the images themselves, against PyTorch's predictions."""
        input:
            model=f"{RESULTS}/model/model.onnx",
            predictions=f"{RESULTS}/model/predictions.h5",
            features=expand(f"{RESULTS}/features/{{session}}.h5", session=IMAGE_SESSIONS),
            raw=[
                name
                for session in IMAGE_SESSIONS
                for name in session_files(session, "session.yaml", "reference.png", "images")
            ],
        output:
            ensure(ONNX_CHECK, non_empty=True),
        log:
            f"{LOGS}/model/onnx_check.log",
        resources:
            runtime=asks(short_seconds),
            mem_mb=2000,
        params:
            source=source_digest("learning/deployment", "learning/elasticity", "learning/models", "recording"),
        shell:
            "{GELFORGE:q} onnx-check --study {STUDY_FILE:q} --model {input.model:q} --out {output:q} &> {log:q}"


rule tables:
    """The article's tables, from what was saved: takes seconds, as no site is solved and nothing trained."""
    input:
        laws=law_files(),
        agreement=f"{RESULTS}/agreement.csv" if STUDY.sessions else [],
        predictions=f"{RESULTS}/model/predictions.h5" if IMAGE_SESSIONS else [],
        labels=[] if IMAGE_SESSIONS else expand(f"{RESULTS}/dataset/shard-{{shard}}.h5", shard=SHARDS),
    output:
        table_files(),
    log:
        f"{LOGS}/tables.log",
    params:
        source=source_digest(
            "materials/fitting/law_file.py",
            "dataset/agreement.py",
            "dataset/ranges.py",
            "learning/judging/error_budget.py",
            "learning/judging/evaluation.py",
            "learning/judging/predictions.py",
            "learning/models/reliability.py",
            "files",
        ),
    shell:
        "{GELFORGE:q} tables --study {STUDY_FILE:q} &> {log:q}"
