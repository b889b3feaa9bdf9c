"""Raw material tests, or given parameters, to one law per material."""


rule characterise:
    """Fit a law to the material's tests, or write down the given one. The same inputs give the same bytes."""
    input:
        tests=material_tests,
    output:
        law=ensure(f"{RESULTS}/materials/{{material}}/law.json", non_empty=True),
        curves=ensure(f"{RESULTS}/materials/{{material}}/curves.csv", non_empty=True),
    log:
        f"{LOGS}/materials/{{material}}.log",
    params:
        material=lambda wildcards: STUDY.materials[wildcards.material].model_dump(mode="json"),
        source=source_digest("characterisation"),
    shell:
        "{GELFORGE} fit-law --study {STUDY_FILE} --material {wildcards.material}"
        " --law {output.law} --curves {output.curves} &> {log}"
