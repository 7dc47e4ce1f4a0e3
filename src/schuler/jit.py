"""How the package compiles its kernels: one set of options, and a word to the user while it happens.

Kernels are module-level functions in files named ``kernels.py`` (``_kernels.py`` where no other package runs them) or
in a folder ``kernels``; their arguments are C-contiguous float64 and
int64 arrays and plain numbers, so that another compiled core can take their place. Those files import numba and
are themselves imported only by the functions that run them (importing the package must stay quick).
"""

from __future__ import annotations

import contextlib
import functools
import glob
import hashlib
import multiprocessing
import pickle
import sys
import threading
import time
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, cast

import llvmlite.binding
import numba
from numba.core.codegen import JITCodeLibrary
from numba.extending import is_jitted

from schuler.jit_beside import WAIT_FOR_ANOTHER_S, hand_over, part_from_beside, start_beside, wait_beside
from schuler.jit_numba import quick_compilation

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None  # type: ignore[assignment]

_NOTICE_AFTER_S = 1.5

_core: Any = numba.core
PLAIN: bool = bool(_core.config.DISABLE_JIT)  # NUMBA_DISABLE_JIT=1: kernels as plain Python, to step through
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}

# Besides the kernel files: what they take constants from (tests/test_project.py holds them to it).
SOURCES = (
    "jit.py",
    "earth.py",
    "filtering/limits.py",
    "filtering/filter_arrays.py",
    "budget/nodes.py",
    "montecarlo/lanes/lane_arrays.py",
)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function when first called, keep the machine code on disk, release the GIL while it runs.

    ``contract`` allows fused multiply-add and nothing else: sums are not reordered, NaN stays NaN.
    """
    return _kept(function, {})


def over_states(function: Callable[..., Any]) -> Callable[..., Any]:
    """Like :func:`kernel` for functions whose hot loops run over states, a number LLVM does not know.

    Such loops are not unrolled: unrolling them is half of the time it takes to compile the filter, and makes it slower,
    by a fifth where the covariance is propagated at every sample.
    """
    return _kept(function, {}, unrolled=False)


def borrowing(function: Callable[..., Any]) -> Callable[..., Any]:
    """Like :func:`over_states` for functions that work on their caller's arrays alone: no reference is counted.

    Counting costs an atomic operation whenever an array or a row of one gets a name, a quarter of the filter's time.
    Such a function must neither make an array (that does not compile) nor return one.
    """
    return _kept(function, {"_nrt": False}, unrolled=False)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Like :func:`borrowing` for small helpers called inside hot loops: asks LLVM to inline them."""
    return _kept(function, {"_nrt": False, "forceinline": True})


def apart(function: Callable[..., Any]) -> Callable[..., Any]:
    """Like :func:`borrowing` for what a run seldom comes to: one function of its own, whoever calls it.

    A helper goes into its callers as often as it is called, with all that it calls itself: numba hands ``forceinline``
    of an inlined caller on to it.
    """
    compiled = _kept(function, {"_nrt": False, "forceinline": False}, unrolled=False)
    cast(Any, compiled).apart = True
    return compiled


def _kept(function: Callable[..., Any], options: dict[str, Any], *, unrolled: bool = True) -> Callable[..., Any]:
    """Compiled function whose machine code on disk is used only while no kernel source has changed.

    numba itself asks only whether the function's own file is newer, and would go on running code into which the old
    version of a helper from another file has been inlined.
    """
    if PLAIN:
        cast(Any, function).py_func = function
        return function
    try:
        compiled: Any = _one_version(numba.njit(cache=True, **options, **_OPTIONS)(function), unrolled)
    except RuntimeError:  # no folder can be written: a read-only installation and home, a service without a home
        _say_not_kept("there is no folder to write to")
        return cast(Callable[..., Any], _one_version(numba.njit(**options, **_OPTIONS)(function), unrolled))
    try:
        file = compiled._cache._cache_file
        file._source_stamp = (file._source_stamp, sources_digest())
        file._load_index = functools.partial(_readable_index, file._load_index)
        cache = compiled._cache
        cache.load_overload = functools.partial(_loaded, cache.load_overload, Path(file._index_path))
        cache.save_overload = functools.partial(_saved, cache.save_overload)
    except AttributeError:  # a numba that keeps it elsewhere: better to compile at every start than to run old code
        compiled = _one_version(numba.njit(**options, **_OPTIONS)(function), unrolled)
    return cast(Callable[..., Any], compiled)


def _one_version(compiled: Any, unrolled: bool) -> Any:
    """The same dispatcher, which gives other kernels one uncompiled part a signature instead of a function of its own.

    numba turns every helper of a kernel into machine code, with wrappers to call it from Python, although its callers
    take its LLVM code in; and it does so anew for every constant that is passed to it. That is a quarter of the time it
    takes to compile the filter. What is called from Python is compiled as usual. A part has no Python environment, so
    kernels neither raise nor print.
    """
    parts: dict[tuple[Any, ...], tuple[Any, object]] = {}
    unliteral = cast(Any, numba.types.unliteral)
    whole, compile_whole = compiled.get_overload, compiled.compile

    def get_call_template(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        plain = tuple(unliteral(value) for value in args)
        named = {name: unliteral(value) for name, value in kws.items()}
        signature, types_ = compiled.fold_argument_types(plain, named)
        if types_ not in parts:
            parts[types_] = _part(compiled, types_)
        name = compiled.py_func.__name__
        return (
            _core.typing.make_concrete_template(f"CallTemplate({name})", name, [parts[types_][0]]),
            signature,
            types_,
            {},
        )

    def get_overload(sig: Any) -> Any:
        part = parts.get(tuple(_core.sigutils.normalize_signature(sig)[0]))
        return part[1] if part else whole(sig)

    def compile_quickly(sig: Any) -> Any:
        with quick_compilation(unrolled), _one_process_at_a_time(compiled):
            return compile_whole(sig)

    compiled.get_call_template, compiled.get_overload = get_call_template, get_overload
    compiled.compile = compile_quickly
    return compiled


@contextlib.contextmanager
def _one_process_at_a_time(compiled: Any) -> Iterator[None]:
    """Wait while another process compiles a kernel of the same file, to load what it leaves on disk.

    The kernel's source is locked, so that nothing is left behind and a killed process holds up nobody; a stopped one
    does for a minute. Threads of one process come here one after the other (numba's lock).
    """
    if fcntl is None or _on_disk(compiled):
        yield
        return
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # no source to be read, a file system without locks
            source = stack.enter_context(open(compiled.py_func.__code__.co_filename, "rb"))
            until = time.monotonic() + WAIT_FOR_ANOTHER_S
            while not _locked(source) and time.monotonic() < until:
                time.sleep(0.05)
        yield


def _locked(file: IO[bytes]) -> bool:
    """Whether this process has the file's lock now; it goes with the file's closing."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class _Part(JITCodeLibrary):
    """LLVM code of a helper, to be linked into its callers and optimised there."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        cast(Any, self)._finalize_dynamic_globals()
        self._finalized = True


def _part(compiled: Any, args: tuple[Any, ...]) -> tuple[Any, object]:
    """Signature of a helper and the key under which kernels find its LLVM code."""
    with _core.compiler_lock.global_compiler_lock:
        data = part_from_beside((compiled, args))
        signature, description, code = _part_read(compiled, data) if data else _compiled_part(compiled, args)
        key = object()
        compiled.targetctx.insert_user_function(key, description, [code])
    return signature, key


def _compiled_part(compiled: Any, args: tuple[Any, ...]) -> tuple[Any, Any, _Part]:
    """Signature, numba's description and LLVM code of a helper."""
    context = compiled.targetctx
    flags = _core.compiler.Flags()
    compiled.targetdescr.options.parse_as_flags(flags, compiled.targetoptions)
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    code = cast(Any, _Part)(context.codegen(), compiled.py_func.__qualname__)
    result = _core.compiler.compile_extra(
        compiled.typingctx, context, compiled.py_func, args, None, flags, {}, library=code
    )
    if hasattr(compiled, "apart") and _functions_take_attributes():
        code._final_module.get_function(result.fndesc.mangled_name).add_function_attribute("noinline")
    return result.signature, result.fndesc, code


@functools.cache
def _functions_take_attributes() -> bool:
    """Whether LLVM's attributes of a function are those of the function: up to llvmlite 0.47 they are of its value."""
    module = cast(Any, llvmlite.binding).parse_assembly("define i32 @f(i32 %x) {\n  ret i32 %x\n}")
    module.get_function("f").add_function_attribute("noinline")
    try:
        module.verify()
    except RuntimeError:
        return False
    return True


def _part_read(compiled: Any, data: bytes) -> tuple[Any, Any, _Part]:
    """The same of a helper that another process has compiled."""
    signature, description, bitcode = pickle.loads(data)  # noqa: S301 - of a process that this one began
    code = cast(Any, _Part)(compiled.targetctx.codegen(), compiled.py_func.__qualname__)
    code._final_module = cast(Any, llvmlite.binding).parse_bitcode(bitcode)
    code._finalize_final_module()
    return signature, description, code


def compile_parts(parts: Iterable[tuple[Callable[..., Any], tuple[Any, ...]]]) -> None:
    """Compile helpers of a kernel over states for the process that compiles the kernel itself and has begun this one.

    Parameters
    ----------
    parts : iterable of (kernel, types)
        As given to :func:`prepare` there.
    """
    for kernel, args in parts:
        with quick_compilation(unrolled=False):
            signature, description, code = _compiled_part(kernel, args)
            cast(Any, code)._ensure_finalized()
        description.typemap = description.calltypes = None  # which numba does not keep on disk either
        hand_over(_core.serialize.dumps((signature, description, code._final_module.as_bitcode())))


def lane_version(function: Callable[..., Any], **helpers: Callable[..., Any]) -> Callable[..., Any]:
    """Compile the Python text of a kernel a second time, for lanes: a dispatcher with machine code of its own on disk.

    One dispatcher for numbers and for lanes would keep both overloads under one index on disk. A process that compiles
    kernels for numbers would then load the lanes' types while it reads that index, in the middle of a compilation, and
    numba cannot take new implementations of operators there (it ends in ``KeyError: (float64,)``).

    Parameters
    ----------
    function : kernel
        Compiled function for numbers, of :func:`kernel` or :func:`inlined`.
    **helpers : kernel
        Under the names that the text uses: what it calls in lanes. Every compiled function that it calls must be there.

    Raises
    ------
    TypeError
        If the text calls a compiled function for which no lane version is given.
    """
    original = cast(Any, function)
    text = original.py_func
    names = {**text.__globals__, **helpers}
    for name in text.__code__.co_names:
        if is_jitted(names.get(name, str)) and name not in helpers:
            raise TypeError(f"lane version of {text.__name__}: expected a lane version of {name}, which it calls")
    second = types.FunctionType(text.__code__, names, text.__name__, text.__defaults__)
    second.__qualname__ = f"{text.__qualname__}_in_lanes"  # numba names the index on disk by it
    second.__doc__ = text.__doc__
    given = getattr(original, "targetoptions", {})  # none in plain Python
    return _kept(second, {name: given[name] for name in ("forceinline", "_nrt") if name in given})


def _readable_index(load: Callable[[], Any]) -> Any:
    """What is on disk of a function; nothing if an earlier version of the package wrote it with types now elsewhere."""
    try:
        return load()
    except (ImportError, AttributeError):
        return {}


def _loaded(load: Callable[..., Any], index: Path, *args: Any) -> Any:
    """Machine code on disk; none if it is damaged (a full disk, a killed run), and its files are removed."""
    try:
        return load(*args)
    except Exception:  # whatever unpickling of damaged bytes ends in; the function is compiled anew
        for path in (index, *index.parent.glob(f"{glob.escape(index.stem)}.*.nbc")):
            with contextlib.suppress(OSError):
                path.unlink()
        return None


def _saved(save: Callable[..., Any], *args: Any) -> None:
    """Keep machine code on disk, where there is room."""
    try:
        save(*args)
    except OSError as error:
        _say_not_kept(str(error.strerror))


@functools.cache
def _say_not_kept(why: str) -> None:
    if multiprocessing.parent_process() is None:
        sys.stderr.write(
            f"the compiled kernels cannot be kept ({why}): every start compiles them anew, about a minute; set "
            "NUMBA_CACHE_DIR to a folder that can be written\n"
        )


@functools.cache
def sources_digest() -> str:
    """SHA-256 over all kernel files and what they take constants from."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted([*root.rglob("*kernels.py"), *root.glob("*/kernels/*.py"), *(root / name for name in SOURCES)]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def direct(function: Callable[..., Any]) -> Callable[..., Any]:
    """A prepared kernel without the look at its arguments' types, for callers who always give the same ones.

    numba asks each argument what it is before it calls: 20 us for the tuples with names that the filter takes, against
    1 us for the call. Arguments of other types than it was prepared for are undefined behaviour.

    Parameters
    ----------
    function : kernel
        Compiled or loaded for one signature (:func:`prepare`); otherwise it is returned as it is.
    """
    overloads = list(cast(Any, function).overloads.values()) if is_jitted(function) else []
    return overloads[0].entry_point if len(overloads) == 1 else function


def prepare(
    kernels: Iterable[tuple[Callable[..., Any], tuple[Any, ...]]],
    beside: str | None = None,
    parts: Sequence[tuple[Callable[..., Any], tuple[Any, ...]]] = (),
) -> None:
    """Load or compile kernels for given argument types before the work starts.

    A first compilation takes some seconds; if it does, one line on the terminal says so, once.

    Parameters
    ----------
    kernels : iterable of (kernel, types)
        The compiled function and the numba types of its arguments.
    beside : str, optional
        ``module:function`` that prepares the kernels wanted next. If these have to be compiled, a process of its own
        does that for them meanwhile, on a second processor, and leaves them on disk.
    parts : sequence of (kernel, types)
        Helpers of these kernels which ``beside`` compiles first, in this order (:func:`compile_parts`).
    """
    pending = [(k, types) for k, types in kernels if is_jitted(k) and not cast(Any, k).signatures]
    if not pending:
        return
    notice = threading.Timer(_NOTICE_AFTER_S, _say_compiling)
    notice.daemon = True
    notice.start()
    modules = {k.__module__ for k, _ in pending}
    try:
        wait_beside(modules)
        if beside is not None and not all(_on_disk(k) for k, _ in pending):
            start_beside(beside, parts)
        for k, types in pending:
            cast(Any, k).compile(types)
    finally:
        notice.cancel()


def _on_disk(compiled: Any) -> bool:
    """Whether there is machine code of this version on disk; true, too, where nothing can be kept there."""
    try:
        load = compiled._cache._cache_file._load_index
    except AttributeError:
        return True
    try:
        return bool(load())
    except Exception:  # a damaged index; loading removes it
        return False


def prepare_beside(name: str, kernel: Callable[..., Any]) -> None:
    """Have a kernel that is wanted later compiled meanwhile, unless it is on disk.

    Parameters
    ----------
    name : str
        ``module:function`` that prepares it, in the kernel's own module.
    kernel : kernel
    """
    if is_jitted(kernel) and not cast(Any, kernel).signatures and not _on_disk(kernel):
        start_beside(name)


def _say_compiling() -> None:
    if sys.stderr.isatty():
        sys.stderr.write(
            "compiling the numerical kernels for this machine (once, up to a minute; later runs start at once)\n"
        )
        sys.stderr.flush()
