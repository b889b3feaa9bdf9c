# The workflow is workflow/Snakefile, where Snakemake's catalog looks for it; `snakemake` finds this file first.
include: "workflow/Snakefile"


workflow.default_target = "all"  # an included file's is not taken over
