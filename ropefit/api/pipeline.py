"""The stages of a run, in order: what each reads and writes.

A stage's work is imported when it is done: an answer that is up to date, or a refusal, loads no
solver.
"""

from __future__ import annotations

from typing import Any

from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.settings import DiagnoseSettings, PreprocessSettings
from ropefit.artifacts import Control, Diagnosis, Model, Observations
from ropefit.fitting.settings import IdentifySettings
from ropefit.runs.protocol import Context, Stage
from ropefit.solvers.compiling import telling

Contents = dict[str, Any]


def _preprocess(inputs: Contents, settings: PreprocessSettings, context: Context) -> Contents:
    from ropefit.stages.preprocess import compute

    return compute(inputs, settings, context)


def _identify(inputs: Contents, settings: IdentifySettings, context: Context) -> Contents:
    from ropefit.stages.identify import compute

    with telling(context.say):
        return compute(inputs, settings, context)


def _diagnose(inputs: Contents, settings: DiagnoseSettings, context: Context) -> Contents:
    from ropefit.stages.diagnose import compute

    with telling(context.say):
        return compute(inputs, settings, context)


def _control(inputs: Contents, settings: ControlSettings, context: Context) -> Contents:
    from ropefit.stages.control import compute

    with telling(context.say):
        return compute(inputs, settings, context)


PREPROCESS = Stage("preprocess", reads=(), writes=Observations, compute=_preprocess)
IDENTIFY = Stage("identify", reads=(Observations,), writes=Model, compute=_identify)
DIAGNOSE = Stage("diagnose", reads=(Observations, Model), writes=Diagnosis, compute=_diagnose)
CONTROL = Stage("control", reads=(Observations, Model), writes=Control, compute=_control)
COMPUTED = (PREPROCESS, IDENTIFY, DIAGNOSE, CONTROL)  # in order
