"""The constitutive models as docs/constitutive-models.md: `python docs/models_table.py` writes it anew."""

from pathlib import Path

from gelforge.mechanics.laws.model import Model
from gelforge.mechanics.laws.models import MODELS

PAGE = Path(__file__).parent / "constitutive-models.md"
HEAD = """\
# Constitutive models

Written by `python docs/models_table.py` from `gelforge/mechanics/laws/models/`, one file for each model
([how to add one](adding/constitutive-model.md)). All are the incompressible (isochoric) part; K/mu is
`mechanics.bulk_to_shear`. A configuration gives parameters as `parameters: {law: yeoh, C10_kPa: 5.0}`, or names what is to
be fitted: `laws: [ogden2, yeoh]`.

| `law` | energy per volume, Young's modulus | keys | fitted as |
|---|---|---|---|
"""


def page(models: dict[str, Model]) -> str:
    """Return the whole page: a row per model."""
    return HEAD + "".join(map(row, models.values()))


def row(model: Model) -> str:
    """Return a model's line of the table."""
    keys = {name: field for name, field in model.parameters.model_fields.items() if name != "law"}
    cells = (
        f"`{model.name}`",
        model.formula,
        "; ".join(f"`{name}`: {field.description}" for name, field in keys.items()),
        ", ".join(f"`{family.name}`" for family in model.families),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


if __name__ == "__main__":
    PAGE.write_text(page(MODELS), encoding="utf-8")
