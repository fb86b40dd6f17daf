"""The sections of the report in the order of the page: the answer, its reasons, the rest."""

from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.candidates import CandidatesSection
from ropefit.reporting.sections.control import ControlSection
from ropefit.reporting.sections.equilibrium import EquilibriumSection
from ropefit.reporting.sections.exports import ExportsSection
from ropefit.reporting.sections.fit import FitSection
from ropefit.reporting.sections.law import LawSection
from ropefit.reporting.sections.next_motion import NextMotionSection
from ropefit.reporting.sections.notes import NotesSection
from ropefit.reporting.sections.observations import ObservationsSection
from ropefit.reporting.sections.parameters import ParametersSection
from ropefit.reporting.sections.pictures import PicturesSection
from ropefit.reporting.sections.provenance import ProvenanceSection
from ropefit.reporting.sections.rope import RopeSection
from ropefit.reporting.sections.simulation import SimulationSection
from ropefit.reporting.sections.solver import SolverSection
from ropefit.reporting.sections.stepping import SteppingSection
from ropefit.reporting.sections.sure import SureSection
from ropefit.reporting.sections.tracks import TracksSection
from ropefit.reporting.sections.where import WhereSection
from ropefit.reporting.sections.why import WhySection

SECTIONS: tuple[Section, ...] = (
    RopeSection(),
    WhereSection(),
    WhySection(),
    LawSection(),
    SimulationSection(),
    SureSection(),
    ParametersSection(),
    NextMotionSection(),
    NotesSection(),
    PicturesSection(),
    TracksSection(),
    CandidatesSection(),
    FitSection(),
    ControlSection(),
    SolverSection(),
    EquilibriumSection(),
    SteppingSection(),
    ExportsSection(),
    ObservationsSection(),
    ProvenanceSection(),
)

__all__ = ["SECTIONS", "Section"]
