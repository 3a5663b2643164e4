"""How kernels are compiled in two thirds of the time that Numba takes.

Numba optimises each function with all that it calls, and makes machine code of it, although it puts
the whole into each caller and optimises it there again: the innermost kernels were compiled once
per level above them. Here kernels that only kernels call are kept as bitcode; only what is called
from Python is optimised and made machine code of. And a tenth of the time went into comparing the
options of compiling with each other, one by one.

Guarantee: callers get the same code to optimise. Non-guarantee: kernels that need Python's objects
when they run (texts of errors made there, prints); they are refused.
"""

from typing import Any

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags


class _Codegen:
    """What makes libraries, for one whose module is not in the engine: it has no environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, *_: Any) -> None:
        """Leave it: nothing of what compiled code reads from it is allowed here."""


class _Bitcode(JITCodeLibrary):
    """A library that is linked into others, and not run."""

    @property
    def codegen(self) -> Any:
        return _Codegen(self._codegen)

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        """As of functions without a wrapper."""
        return 0

    def serialize_using_object_code(self) -> Any:
        return self.name, "bitcode", self._get_module_for_linking().as_bitcode()


_HASH, _DEFAULTS = hash(Flags()), Flags().values()


class _Quick(Flags):
    """Options of compiling that are compared by those that were given."""

    __slots__ = ()

    def __hash__(self) -> int:
        return _HASH

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Flags):
            return NotImplemented
        return self._values == other._values or self.values() == other.values()

    def values(self) -> dict[str, Any]:
        return _DEFAULTS | self._values


class ToMachine(Compiler):
    """Compiles a function as Numba does."""

    def compile_extra(self, func: Any) -> Any:
        self.state.flags = _Quick(self.state.flags)
        return super().compile_extra(func)


class ToBitcode(ToMachine):
    """Compiles a function up to what its callers link."""

    def compile_extra(self, func: Any) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = _Bitcode(codegen, func.__qualname__)
        out = super().compile_extra(func)
        if out.environment.consts:
            raise TypeError(f"{func.__name__} needs objects of Python: it cannot be inner")
        return out


class _Kept(CompileResultCacheImpl):
    """How it is read from the disk."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        (name, _, code), fndesc, environment, signature, _, _, notes, *_ = payload
        library = _Bitcode(target_context.codegen(), name)
        library._final_module = binding.parse_bitcode(code)
        library._finalize_final_module()
        return CompileResult(
            typing_context=target_context.typing_context,
            target_context=target_context,
            entry_point=target_context.get_executable(library, fndesc, environment),
            typing_error=None,
            type_annotation=notes,
            library=library,
            signature=signature,
            objectmode=False,
            lifted=(),
            call_helper=None,
            fndesc=fndesc,
            environment=environment,
            metadata=None,
            reload_init=[],
            referenced_envs=[],
        )


class BitcodeCache(FunctionCache):
    """Where it is kept."""

    _impl_class = _Kept
