"""How helpers become part of entry points: linked as they are, and optimised there, once.

By itself numba optimises every helper with all that it calls, and translates it into machine code
that nobody runs; an entry point then has code in it that was optimised at every level of calls.
That would be a third of the time of compilation.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes, NativeLowering


class HelperLibrary(JITCodeLibrary):
    """Code of one helper, not yet optimised, without that of what it calls."""

    def finalize(self) -> None:
        """Leave the code to the entry points."""
        self._finalized = True


class NotInlinedLibrary(HelperLibrary):
    """Code of a helper that LLVM does not inline."""

    def finalize(self) -> None:
        """Leave the code to the entry points, as functions of their own."""
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.add_function_attribute("noinline")
        super().finalize()


class EntryLibrary(JITCodeLibrary):
    """Code of an entry point."""

    def finalize(self) -> None:
        """Link in what helpers call, directly or not, optimise all of it, and translate it."""
        linked = self._linking_libraries
        for library in linked:  # it grows meanwhile
            if isinstance(library, HelperLibrary):
                linked.extend(found for found in library._linking_libraries if found not in linked)
        super().finalize()


class _InLibrary(LoweringPass):
    """Give a function a library of our own kind."""

    library: type[JITCodeLibrary]

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Set the library that `NativeLowering` fills."""
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.flags.no_compile = issubclass(self.library, HelperLibrary)
        return False


@register_pass(mutates_CFG=False, analysis_only=False)
class InEntryLibrary(_InLibrary):
    """Give an entry point its library."""

    _name, library = "ropefit_in_entry_library", EntryLibrary


@register_pass(mutates_CFG=False, analysis_only=False)
class InHelperLibrary(_InLibrary):
    """Give a helper its library."""

    _name, library = "ropefit_in_helper_library", HelperLibrary


@register_pass(mutates_CFG=False, analysis_only=False)
class InNotInlinedLibrary(_InLibrary):
    """Give a helper that is not inlined its library."""

    _name, library = "ropefit_in_not_inlined_library", NotInlinedLibrary


@register_pass(mutates_CFG=False, analysis_only=False)
class KnownToCallers(LoweringPass):
    """Let other functions call a helper: as numba does, but without machine code."""

    _name = "ropefit_known_to_callers"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Stand in for what numba leaves out where nothing is translated."""
        fndesc, env = state.cr.fndesc, state.cr.env
        name, module = fndesc.qualname.split(".")[-1], fndesc.lookup_module()
        key = _dynfunc.make_function(module, name, "", 0, env, (state.library,))
        state.targetctx.insert_user_function(key, fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=key)
        return True


class EntryCompiler(CompilerBase):
    """numba's compiler for an entry point."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, and our library."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(InEntryLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


class HelperCompiler(CompilerBase):
    """numba's compiler for a helper."""

    found_in: type[_InLibrary] = InHelperLibrary

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, our library, and nothing that makes machine code."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(self.found_in, AnnotateTypes)
        passes.add_pass_after(KnownToCallers, NativeLowering)
        passes.finalize()
        return [passes]


class NotInlinedCompiler(HelperCompiler):
    """numba's compiler for a helper that LLVM does not inline."""

    found_in = InNotInlinedLibrary
