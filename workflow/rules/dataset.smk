"""Labels and features joined into shards, and what stands next to the shards."""

# not all of `dataset`: no rule writes exports, and a new format is no reason to join again
JOIN_SOURCES = [f"dataset/{name}.py" for name in ("join", "schema", "session_labels", "shard", "splits")]


rule join:
    """One shard: a fixed chunk of the plan's sites with every recorded image of their indentations."""
    input:
        laws=law_files(),
        cells=lambda wildcards: cell_files(shard_cells(wildcards.shard)),
        own=lambda wildcards: session_label_files(shard_cells(wildcards.shard)),
        features=expand(f"{RESULTS}/features/{{session}}.h5", session=IMAGE_SESSIONS),
    output:
        ensure(f"{RESULTS}/dataset/shard-{{shard}}.h5", non_empty=True),
    log:
        f"{LOGS}/dataset/shard-{{shard}}.log",
    resources:
        runtime=asks(short_seconds),
    params:
        study=block("seed", "dataset", "plan", "sensor", "sessions"),
        split=digest(SPLIT),
        source=source_digest(*JOIN_SOURCES),
    shell:
        "{GELFORGE:q} join --study {STUDY_FILE:q} --shard {wildcards.shard:q} --out {output:q} &> {log:q}"


rule manifest:
    """What the dataset holds: checksums, provenance, card and Croissant description."""
    input:
        shards=expand(f"{RESULTS}/dataset/shard-{{shard}}.h5", shard=SHARDS),
        features=expand(f"{RESULTS}/features/{{session}}.h5", session=IMAGE_SESSIONS),
    output:
        multiext(f"{RESULTS}/dataset/", "manifest.json", "SHA256SUMS", "README.md", "croissant.json"),
    log:
        f"{LOGS}/dataset/manifest.log",
    params:
        study=digest(STUDY.dataset_settings),
        source=source_digest(*JOIN_SOURCES, "dataset/card.py", "dataset/manifest.py"),
    shell:
        "{GELFORGE:q} manifest --study {STUDY_FILE:q} &> {log:q}"


rule labels:
    """The dataset without training anything."""
    input:
        f"{RESULTS}/dataset/manifest.json",


rule agreement:
    """Total force of the finite elements and the force sensor's, indentation by indentation."""
    input:
        laws=law_files(),
        cells=cell_files(CELLS),
        own=session_label_files(CELLS),
        readings=expand(f"{RESULTS}/recordings/{{session}}.csv", session=STUDY.sessions),
    output:
        ensure(f"{RESULTS}/agreement.csv", non_empty=True),
    log:
        f"{LOGS}/agreement.log",
    params:
        source=source_digest(*JOIN_SOURCES, "dataset/agreement.py"),
    shell:
        "{GELFORGE:q} agreement --study {STUDY_FILE:q} --out {output:q} &> {log:q}"
