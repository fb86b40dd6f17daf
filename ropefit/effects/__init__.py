"""The catalogue of what a model may have left out; one file an effect.

A new effect is one file and its line here, see docs/adding-an-effect.md. Effects with a
`calibration` enter every fit in this order.
"""

from ropefit.effects.axial_extensibility import AxialExtensibility
from ropefit.effects.axial_law import AxialLaw
from ropefit.effects.base import Effect, Quantity
from ropefit.effects.bending_hysteresis import BendingHysteresis
from ropefit.effects.bending_law import BendingLaw
from ropefit.effects.clamped_end import ClampedEnd, TiltedClamp
from ropefit.effects.contact_friction import ContactFriction
from ropefit.effects.damping import Damping, DampingInMotion
from ropefit.effects.depth_bias import DepthBias, DepthGain
from ropefit.effects.distributed_load import DistributedLoad
from ropefit.effects.drag_law import DragLaw
from ropefit.effects.end_offset import EndOffset
from ropefit.effects.end_twist import EndTwist
from ropefit.effects.follower_force import FollowerForce
from ropefit.effects.force_field import ForceField
from ropefit.effects.gradual_friction import GradualFriction
from ropefit.effects.gravity_misalignment import GravityMisalignment
from ropefit.effects.half_space import HalfSpace
from ropefit.effects.inertia import Inertia
from ropefit.effects.intrinsic_curvature import FreeCurvature, IntrinsicCurvature
from ropefit.effects.kink import FreeKink, Kink
from ropefit.effects.length_error import LengthError
from ropefit.effects.lost_out_of_plane import LostOutOfPlane
from ropefit.effects.mass_section import MassSection
from ropefit.effects.obstacle import Obstacle
from ropefit.effects.plastic_set import PlasticSet
from ropefit.effects.point_force import PointForce
from ropefit.effects.point_mass import PointMass
from ropefit.effects.rest_shape import RestShape
from ropefit.effects.scale_error import ScaleError
from ropefit.effects.soft_section import SoftSection
from ropefit.effects.stiff_section import StiffSection
from ropefit.effects.support_plane import SupportPlane
from ropefit.effects.tether import Tether
from ropefit.effects.time_lag import TimeLag
from ropefit.effects.too_coarse import TooCoarse
from ropefit.effects.under_converged import UnderConverged
from ropefit.effects.viscoelastic_creep import ViscoelasticCreep
from ropefit.effects.wall_field import WallField
from ropefit.effects.weight_error import WeightError

CATALOGUE: tuple[type[Effect], ...] = (
    PointMass,
    MassSection,
    IntrinsicCurvature,
    FreeCurvature,
    RestShape,
    Kink,
    FreeKink,
    StiffSection,
    SoftSection,
    AxialExtensibility,
    DistributedLoad,
    ClampedEnd,
    TiltedClamp,
    EndTwist,
    Tether,
    PointForce,
    SupportPlane,
    Obstacle,
    ContactFriction,
    BendingHysteresis,
    GradualFriction,
    PlasticSet,
    ViscoelasticCreep,
    Inertia,
    Damping,
    DampingInMotion,
    DepthGain,
    TimeLag,
    DepthBias,
    ScaleError,
    GravityMisalignment,
    EndOffset,
    WeightError,
    LengthError,
    LostOutOfPlane,
    BendingLaw,
    AxialLaw,
    DragLaw,
    ForceField,
    WallField,
    HalfSpace,
    FollowerForce,
    TooCoarse,
    UnderConverged,
)

__all__ = ["CATALOGUE", "Effect", "Quantity", *(effect.__name__ for effect in CATALOGUE)]
