"""The sections of the report in the order of the page."""

from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.control import ControlSection
from ropefit.reporting.sections.diagnosis import DiagnosisSection
from ropefit.reporting.sections.equilibrium import EquilibriumSection
from ropefit.reporting.sections.exports import ExportsSection
from ropefit.reporting.sections.motion import MotionSection
from ropefit.reporting.sections.observations import ObservationsSection
from ropefit.reporting.sections.overlay import OverlaySection
from ropefit.reporting.sections.parameters import ParametersSection
from ropefit.reporting.sections.pictures import PicturesSection
from ropefit.reporting.sections.provenance import ProvenanceSection
from ropefit.reporting.sections.residual import ResidualSection
from ropefit.reporting.sections.solver import SolverSection
from ropefit.reporting.sections.stepping import SteppingSection
from ropefit.reporting.sections.summary import SummarySection
from ropefit.reporting.sections.tracks import TracksSection

SECTIONS: tuple[Section, ...] = (
    SummarySection(),
    OverlaySection(),
    PicturesSection(),
    TracksSection(),
    ResidualSection(),
    DiagnosisSection(),
    ParametersSection(),
    ControlSection(),
    SolverSection(),
    EquilibriumSection(),
    SteppingSection(),
    MotionSection(),
    ExportsSection(),
    ObservationsSection(),
    ProvenanceSection(),
)

__all__ = ["SECTIONS", "Section"]
