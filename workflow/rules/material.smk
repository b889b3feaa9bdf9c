"""Raw material tests, or given parameters, to one constitutive model per material."""

MATERIAL = f"{RESULTS}/materials/{{material}}"


rule characterise:
    """Fit constitutive models to the tests and measure effects, or write the given one: equal inputs give equal bytes."""
    input:
        tests=material_tests,
    output:
        *(
            ensure(f"{MATERIAL}/{name}", non_empty=True)
            for name in (
                "law.json",
                "curves.csv",
                "effects.json",
                "effects.csv",
                "laws.csv",
                "parameters.csv",
            )
        ),
        laws=directory(f"{MATERIAL}/laws"),
    log:
        f"{LOGS}/materials/{{material}}.log",
    resources:
        runtime=asks(fit_seconds),
    params:
        material=lambda wildcards: STUDY.materials[wildcards.material].model_dump(mode="json"),
        source=source_digest("materials", "mechanics/laws"),
    shell:
        "{GELFORGE:q} fit-law --study {STUDY_FILE:q} --material {wildcards.material:q}"
        " --out {RESULTS:q}/materials/{wildcards.material:q} &> {log:q}"
