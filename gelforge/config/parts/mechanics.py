"""The finite-element model of one indentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import Field, model_validator

from gelforge.config.parts.effects import Effects
from gelforge.section import Name, Positive, Section

# far_mm over near_mm, ten halvings of the base grid; the mesh of Sferrazza et al. 2019 has 4.
LARGEST_RATIO = 1000.0


@dataclass(frozen=True)
class Quality:
    """What a choice of quality multiplies."""

    sizes: float  # near_mm, far_mm and the elements through the wall
    growth: float
    step: float  # solver.longest_step: steps of 0.54, 0.3 and 0.3 mm where the standard near_mm is 0.3


# gelforge/cli/study/mesh_errors.csv has what each errs by and costs.
QUALITIES = {
    "fast": Quality(sizes=4 / 3, growth=1.4, step=1.35),
    "standard": Quality(sizes=1.0, growth=1.0, step=1.0),
    "fine": Quality(sizes=2 / 3, growth=1.0, step=1.5),
}


class Mesh(Section):
    """Elements and their sizes: hexahedra of an even grid, halved where the contact wants it, or quadratic tetrahedra."""

    elements: Literal["auto", "hexahedra", "tetrahedra"] = Field(
        "auto",
        description="auto: hexahedra for a block, 10-node tetrahedra (sizes between their nodes) for other shapes",
    )
    quality: Literal["fast", "standard", "fine"] = Field(
        "standard",
        description="fast: the sizes below times 4/3, for exploring; fine: times 2/3; the error bars follow",
    )
    near_mm: Positive = Field(0.3, description="element size under the contact [mm]")
    near_radius_mm: Positive = Field(3.6, description="radius of the fine region around the contact [mm]")
    growth: float = Field(0.25, gt=0, le=2, description="growth of the size per mm of distance from it [-]")
    far_mm: Positive = Field(1.2, description="largest element size; near_mm or less: an even mesh [mm]")
    wall_parts: Positive = Field(
        2.0,
        description="elements (of tetrahedra: distances between nodes) through the wall, or a thin skin of a tetrahedral"
        " mesh, within the sensor's height of the contact [-]",
    )
    envelope_mm: Positive = Field(
        0.04,
        description="how far tetrahedra may stray from a surface before nodes are moved onto it, near_mm / 6 at most [mm]",
    )

    @model_validator(mode="after")
    def _halvings(self):
        if self.far_mm > LARGEST_RATIO * self.near_mm:
            raise ValueError(
                f"far_mm {self.far_mm:g} is more than {LARGEST_RATIO:g} times near_mm {self.near_mm:g}; make it smaller"
            )
        return self

    @property
    def used(self) -> Mesh:
        """These as they are meshed: of standard quality, with the sizes and the growth of this one's."""
        factors = QUALITIES[self.quality]
        as_meshed = {"quality": "standard", "growth": factors.growth * self.growth}
        return self.coarser(factors.sizes).with_values(as_meshed)

    def coarser(self, factor: float) -> Mesh:
        """Return these with near, far and the wall's size multiplied, and the envelope with the square.

        An edge's distance from a curve goes with the square of its length: in a narrower envelope the edges stay short.
        """
        sizes = {"near_mm": factor * self.near_mm, "far_mm": factor * self.far_mm}
        sizes["wall_parts"] = self.wall_parts / factor
        return self.with_values(sizes | {"envelope_mm": factor**2 * self.envelope_mm})


class Contact(Section):
    """Contact of element faces with the indenter, and how fast its iteration closes gaps and stops slips.

    No solution depends on the augmentations, which are over shear modulus per element size.
    """

    normal_augmentation: Positive = Field(50.0, description="of gaps [-]")
    tangential_augmentation: Positive = Field(1000.0, description="of slips [-]")
    facets: float = Field(
        0.75,
        ge=0,
        le=1,
        description="share of the faces' mean distance inside a curved indenter by which hexahedra are pressed on [-]",
    )


class Solver(Section):
    """Stopping rules of the Newton iteration."""

    force_tolerance: float = Field(
        1e-6, gt=0, le=1e-2, description="unbalanced force, and error of friction, over contact force [-]"
    )
    gap_tolerance: float = Field(
        1e-4, gt=0, le=1e-2, description="largest penetration of a contact node over its element size [-]"
    )
    longest_step: float = Field(
        1.0,
        gt=0,
        le=10,
        description="longest step of the indenter over the element size: friction depends on the path [-]",
    )
    max_iterations: int = Field(40, ge=2, le=500, description="Newton iterations of one depth step [-]")
    max_halvings: int = Field(
        4, ge=0, le=10, description="times a depth step may be halved before giving up [-]"
    )
    linear_solver: Literal["auto", "pardiso", "superlu"] = Field("auto", description="sparse direct solver")


class Mechanics(Section):
    """The finite-element model of one indentation."""

    strain: Literal["finite", "small"] = Field(
        "finite", description="finite strain, or small-strain linear elasticity"
    )
    contact_normals: Literal["current", "initial"] = Field(
        "current", description="contact normals of the ball (current) or of the undeformed surface (initial)"
    )
    friction: float = Field(0.45, ge=0, le=2, description="Coulomb friction coefficient [-]")
    bulk_to_shear: float = Field(
        1000.0, ge=10, le=1e5, description="bulk modulus over shear modulus of each layer [-]"
    )
    binning: Literal["shape_function", "node"] = Field(
        "shape_function",
        description="share nodal forces by shape functions, or give them to the bin of the node",
    )
    mesh: Mesh = Field(Mesh(), description="mesh sizes")
    contact: Contact = Field(Contact(), description="contact constants")
    solver: Solver = Field(Solver(), description="stopping rules")
    error_bars: bool = Field(
        True,
        description="store the error bars of forces, from a coarse-mesh solution on a mesh of twice the sizes",
    )
    sensitivities: list[Name] = Field(
        [],
        description="effects whose derivatives of total and bin forces are stored, e.g. gel_stiffness; with "
        "store_displacement those of the gel's displacement too",
    )
    store_displacement: bool = Field(False, description="keep the gel's displacement in the site's file")
    effects: Effects = Field(Effects(), description="physics that the plain model leaves out")

    @model_validator(mode="after")
    def _normals(self):
        if self.contact_normals == "initial" and self.strain == "finite":
            raise ValueError("contact_normals: initial belongs to strain: small")
        finite_only = self.effects.history.any or self.effects.geometry.prestretch
        if self.strain == "small" and finite_only:
            raise ValueError(
                "effects.history and geometry.prestretch need strain: finite, found small; change it or leave them out"
            )
        return self
