"""Study, session and virtual-lab descriptions: YAML in, validated models out.

This is the only package that names configuration keys and the only one that reads YAML. Keys carry their unit; nothing is
converted here. An unknown or out-of-range key is refused with its full path, the value found and the limit.
"""

from gelforge.config.basis.variants import Variant
from gelforge.config.parts.camera import Camera, Distortion, Port
from gelforge.config.parts.effects import Effects
from gelforge.config.parts.learning import Features, Learning
from gelforge.config.parts.materials import LAW_NAMES, Fitting, LawParameters, Material
from gelforge.config.parts.mechanics import Mechanics, Mesh
from gelforge.config.parts.plan import Interpolation, Plan
from gelforge.config.parts.sensor import Bins, Indenter, IndenterPart, Layer, Sensor, Shape
from gelforge.config.sessions.session import DepthZero, ForceSensor, Session, StageToSensor
from gelforge.config.sessions.virtual_lab import (
    PrintedDots,
    VirtualImaging,
    VirtualLab,
    VirtualParticles,
    VirtualSample,
    VirtualSession,
)
from gelforge.config.studies.circumstances import session_study
from gelforge.config.studies.files import (
    changed_study,
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
from gelforge.config.studies.study import SOFT_SHARE, Study
from gelforge.mechanics.laws.models.ogden import OgdenParameters
from gelforge.section import (
    NAME,
    ConfigError,
    Name,
    NonNegative,
    Positive,
    Section,
    given,
)
