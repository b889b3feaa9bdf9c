"""Recorded sessions, measured or synthetic: readings on the sensor, and features of its images."""


rule readings:
    """Forces on the sensor, in the sensor's frame, zero subtracted, and what the tests of the session found."""
    input:
        raw=lambda wildcards: session_files(
            wildcards.session, "session.yaml", "indentations.csv", "ft.csv", "reference.png", "images"
        ),
    output:
        readings=ensure(f"{RESULTS}/recordings/{{session}}.csv", non_empty=True),
        findings=f"{RESULTS}/recordings/{{session}}.findings.csv",
    log:
        f"{LOGS}/recordings/{{session}}.log",
    params:
        sensor=block("sensor", "plan"),
        joined=joined_sites,
        images=image_content,
        source=source_digest("recording"),
    shell:
        "{GELFORGE:q} readings --study {STUDY_FILE:q} --session {wildcards.session:q}"
        " --out {output.readings:q} &> {log:q}"


rule features:
    """Optical flow of every image of a session against its reference image, averaged over regions."""
    input:
        readings=f"{RESULTS}/recordings/{{session}}.csv",
        raw=lambda wildcards: session_files(
            wildcards.session, "session.yaml", "indentations.csv", "reference.png", "images"
        ),
    output:
        ensure(f"{RESULTS}/features/{{session}}.h5", non_empty=True),
    log:
        f"{LOGS}/features/{{session}}.log",
    benchmark:
        f"{BENCHMARKS}/features/{{session}}.tsv"
    threads: 2
    resources:
        runtime=asks(features_seconds),
        mem_mb=1500,
    params:
        features=block("features"),
        joined=joined_sites,
        images=image_content,
        source=source_digest("recording"),
    shell:
        "{GELFORGE:q} features --study {STUDY_FILE:q} --session {wildcards.session:q} --workers {threads:q}"
        " --out {output:q} &> {log:q}"
