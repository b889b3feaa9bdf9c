"""Study, session and virtual-lab descriptions: YAML in, validated models out.

This is the only package that names configuration keys and the only one that reads YAML. Keys carry their unit; nothing is
converted here. An unknown or out-of-range key is refused with its full path, the value found and the limit.
"""

from gelforge.config.camera import Camera, Distortion, Port, Remap
from gelforge.config.circumstances import session_study
from gelforge.config.common import NAME, ConfigError, Fraction, Name, NonNegative, OldKey, Positive, Section
from gelforge.config.effects import Effects
from gelforge.config.files import (
    load_camera,
    load_section,
    load_session,
    load_study,
    load_virtual_lab,
    schema,
    section_from,
    study_from,
    variant_study,
    write_yaml,
)
from gelforge.config.learning import Dataset, Features, Learning
from gelforge.config.materials import LAW_NAMES, Fitting, LawParameters, Material
from gelforge.config.mechanics import Contact, Mechanics, Mesh, Solver
from gelforge.config.plan import Grid, Interpolation, Plan
from gelforge.config.sensor import Bins, Flange, Indenter, IndenterPart, Layer, Sensor, Shape
from gelforge.config.session import DepthZero, ForceSensor, Session, StageToSensor
from gelforge.config.study import SOFT_SHARE, Study
from gelforge.config.synthesis import Synthesis
from gelforge.config.variants import Variant
from gelforge.config.virtual_lab import (
    VirtualForce,
    VirtualImaging,
    VirtualLab,
    VirtualParticles,
    VirtualSample,
    VirtualSession,
)
from gelforge.mechanics.laws.models.ogden import OgdenParameters

__all__ = [
    "SOFT_SHARE",
    "Bins",
    "Camera",
    "ConfigError",
    "Contact",
    "Dataset",
    "DepthZero",
    "Distortion",
    "Effects",
    "Features",
    "Fitting",
    "Flange",
    "ForceSensor",
    "Fraction",
    "Grid",
    "Indenter",
    "IndenterPart",
    "Interpolation",
    "LAW_NAMES",
    "LawParameters",
    "Layer",
    "Learning",
    "Material",
    "Mechanics",
    "Mesh",
    "NAME",
    "Name",
    "NonNegative",
    "OgdenParameters",
    "OldKey",
    "Plan",
    "Port",
    "Positive",
    "Remap",
    "Section",
    "Sensor",
    "Shape",
    "Session",
    "Solver",
    "StageToSensor",
    "Study",
    "Synthesis",
    "Variant",
    "VirtualForce",
    "VirtualImaging",
    "VirtualLab",
    "VirtualParticles",
    "VirtualSample",
    "VirtualSession",
    "load_camera",
    "load_section",
    "load_session",
    "load_study",
    "load_virtual_lab",
    "schema",
    "section_from",
    "session_study",
    "study_from",
    "variant_study",
    "write_yaml",
]
