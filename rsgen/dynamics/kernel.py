"""A compiled force law: source to machine code, kept on disk, loaded, and called for many test points.

    m x'' + n(x, x') = Re F exp(i omega t),    (x, x'/omega) at t = 0  ->  the same q periods later

``kernel_source`` writes the integrator of a law as source and says how it works. numba translates it to
LLVM's language, LLVM optimises it once and makes machine code, which is stored in a file named by the hash of
all that it depends on, in a folder of this user alone. Where no folder can be trusted, kernels are compiled
in every process and stored nowhere. Machine code checks nothing, so that the arrays are checked here.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import secrets
import stat
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

import numpy as np
import platformdirs
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.output import MAX_BYTES, is_alive
from rsgen.dynamics.kernel_source import MemoryRows, generate, parameter_order
from rsgen.law.memory import memory_form

# ----------------------------------------------------------------------------
# A folder whose files only its user can write; each begins with a digest that finds damage.
#
# Machine code is loaded from here and runs as the user. So a folder or a file counts only when it belongs to
# the user and no other user can write it. That is asked of the opened descriptor, since what a name means can
# change between two looks. A link, a pipe or a device is never followed, and the size of a file is known
# before anything is read.

_DIGEST_BYTES = hashlib.sha256().digest_size

_UNFINISHED = re.compile(r"\..+\.(?P<writer>\d+)\.[0-9a-f]+\.part")

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_PLAIN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)


class UntrustedFolderError(Exception):
    """A folder cannot be made, or another user could have written what is in it; the text says why."""


@dataclass(frozen=True, slots=True)
class PrivateFolder:
    """An opened folder of this user.

    Parameters
    ----------
    descriptor
        Of the folder; every file is opened relative to it.
    """

    descriptor: int

    def read(self, name: str) -> bytes | None:
        """Read what ``write`` wrote under a name; None where it is missing, damaged or of another user."""
        whole = _read(self.descriptor, name)
        if whole is None or whole[:_DIGEST_BYTES] != _digest(name, whole[_DIGEST_BYTES:]):
            return None
        return whole[_DIGEST_BYTES:]

    def write(self, name: str, content: bytes) -> None:
        """Write a file whole, in place of what had the name.

        Raises
        ------
        OSError
            The disk is full, or a folder that is not empty has the name.
        """
        _write(self.descriptor, name, _digest(name, content) + content)

    def clear(self) -> None:
        """Remove what killed writers left."""
        for name in os.listdir(self.descriptor):  # noqa: PTH208 - pathlib opens no descriptors
            found = _UNFINISHED.fullmatch(name)
            # of a writer on another machine it may be taken too soon; then its kernel is not stored
            if found and not is_alive(int(found["writer"])):
                with suppress(OSError):
                    os.unlink(name, dir_fd=self.descriptor)


def _digest(name: str, content: bytes) -> bytes:
    """Return a digest that finds damage, and a file under the name of another."""
    return hashlib.sha256(name.encode() + b"\0" + content).digest()


@contextmanager
def open_private_folder(path: Path) -> Iterator[PrivateFolder]:
    """Open a folder of this user; make it, for this user alone, where it is missing.

    Raises
    ------
    UntrustedFolderError
        It cannot be made or opened, is a link or no folder, belongs to another user, others may write into
        it, or the system cannot say (Windows).
    """
    if os.name != "posix":
        raise UntrustedFolderError("this system does not say who else can write there")
    try:
        _make(path)
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | _PLAIN)
    except (OSError, ValueError) as fault:
        # O_NOFOLLOW refuses a link as if it were no folder
        raise UntrustedFolderError(f"no folder, or a link: {getattr(fault, 'strerror', fault)}") from fault
    try:
        found = os.fstat(descriptor)
        if found.st_uid != os.geteuid():
            raise UntrustedFolderError("it belongs to another user")
        if found.st_mode & _OTHERS_WRITE:
            raise UntrustedFolderError("other users may write into it")
        folder = PrivateFolder(descriptor)
        folder.clear()
        yield folder
    finally:
        os.close(descriptor)


def _make(path: Path) -> None:
    """Make a folder and the missing ones above it; the umask decides nothing."""
    for folder in (*reversed(path.absolute().parents), path.absolute()):
        if not folder.exists():
            with suppress(FileExistsError):
                folder.mkdir(0o700)


def _read(folder: int, name: str) -> bytes | None:
    """Read a plain file of this user that no other user can write."""
    try:
        descriptor = os.open(name, os.O_RDONLY | _PLAIN, dir_fd=folder)
    except OSError:
        return None
    try:
        found = os.fstat(descriptor)
        own = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid()
        if not own or found.st_mode & _OTHERS_WRITE or found.st_size > MAX_BYTES:
            return None
        return os.read(descriptor, found.st_size)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _write(folder: int, name: str, content: bytes) -> None:
    unfinished = f".{name}.{os.getpid()}.{secrets.token_hex(4)}.part"
    descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN, 0o600, dir_fd=folder)
    try:
        with os.fdopen(descriptor, "wb") as file:
            # where the umask forbids even the owner
            os.fchmod(descriptor, 0o600)
            file.write(content)
        with suppress(OSError):
            # an empty folder that has taken the name; others stay, and the file is not stored
            os.rmdir(name, dir_fd=folder)
        os.rename(unfinished, name, src_dir_fd=folder, dst_dir_fd=folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(unfinished, dir_fd=folder)
        raise


# ----------------------------------------------------------------------------
# Kernel sources to machine code and back to functions: numba compiles, afterwards LLVM alone loads.
#
# Loading through numba costs its import and a third of a second; the object code itself is there in
# milliseconds, and a program that finds all its kernels in the cache never imports numba.

_FOREIGN = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("exp", "log", "pow", "sqrt", "fmod", "ldexp", "memset", "memcpy", "memmove"),
}
"""Symbols that machine code may call; any other would be missing when it is loaded."""

_OWNER = re.compile(r"^declare void( @NRT_MemInfo_call_dtor)(\([^)]*\)).*$", re.MULTILINE)
"""Numba frees arrays through this; those of a kernel belong to its caller, and nothing is ever freed."""

# as ``enter`` in the template: points, k; y, its rows, history, F, omega, n, m, values, P, phases, ...
_P, _I, _D = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
_ARGUMENTS = (_P, _I, _P, _I, _P, _P, _P, _I, _D, _P, _I, _P, _I, _I, _P, _I, _P, _I, _P)

_compiler_lock = Lock()


def _llvm() -> Any:
    return import_module("llvmlite.binding")  # what numba itself compiles with


def host() -> tuple[str, str]:
    """Name and features of this machine's processor; code for one need not run on another."""
    llvm = _llvm()
    # the features of a virtual machine can differ from those of its named processor
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@lru_cache(maxsize=1)
def _engine() -> tuple[Any, Any]:
    """Target machine and execution engine of this process, for all kernels."""
    llvm = _llvm()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    name, features = host()

    def machine() -> Any:
        return llvm.Target.from_default_triple().create_target_machine(
            cpu=name,
            # vectors as wide as there are: kernels do little else than vector arithmetic
            features=f"{features},-prefer-256-bit,-prefer-128-bit" if "+avx" in features else features,
            opt=3,
            reloc="default",
            codemodel="jitdefault",
        )

    # an engine owns its machine
    return machine(), llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine())


def _import(source: str, name: str) -> ModuleType:
    """Make a module of a source that stands in no file."""
    module = ModuleType(name)
    # numba finds the globals of a function by the name of its module
    sys.modules[name] = module
    try:
        exec(source, vars(module))  # noqa: S102 - generated by this package, nothing else is executed
    finally:
        sys.modules.pop(name, None)
    return module


@contextmanager
def _translation_only() -> Iterator[None]:
    """Let numba translate to LLVM's language and no further, for as long as no other thread compiles.

    Numba itself makes machine code of every function by itself and of all of them together; what is optimised
    once, at the end, compiles in half the time.
    """
    config: Any = import_module("numba.core.config")
    codegen: Any = import_module("numba.core.codegen")
    level = config.OPT
    instead = (
        (config, "OPT", type(level)(0)),
        (codegen.JITCodeLibrary, "_finalize_specific", lambda self: None),
        (codegen.JITCPUCodegen, "_add_module", lambda self, module: None),
        (codegen.JITCPUCodegen, "set_env", lambda self, name, environment: None),
    )
    before = [(place, name, getattr(place, name)) for place, name, _ in instead]
    with import_module("numba.core.compiler_lock").global_compiler_lock:
        try:
            for place, name, value in instead:
                setattr(place, name, value)
            yield
        finally:
            for place, name, value in before:
                setattr(place, name, value)


def compile_source(source: str, name: str) -> tuple[bytes, str]:
    """Compile the ``enter`` of a kernel source.

    Parameters
    ----------
    source
        Of the kernel; it is generated by this package, nothing else is ever executed.
    name
        Of the module: becomes part of the symbol, and must be unique among all kernels of a process.

    Returns
    -------
    tuple
        Object code for this machine, and the symbol of its entry.

    Raises
    ------
    RsgenError
        The machine code would need something that is not there when it is loaded.
    """
    llvm = _llvm()
    with _compiler_lock:
        machine, _ = _engine()
        with _translation_only():
            entry = _import(source, name).enter
        # the wrapper of numba reports errors to Python; the function inside it has none to report
        symbol = entry.native_name.removeprefix("cfunc.")
        module = llvm.parse_assembly(
            _OWNER.sub(r"define internal void\g<1>\g<2> { ret void }", entry.inspect_llvm())
        )
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        for function in module.functions:
            if not function.is_declaration and function.name != symbol:
                function.linkage = "internal"
        for variable in module.global_variables:
            if not variable.is_declaration:
                variable.linkage = "internal"
        module.get_function(symbol).linkage = "external"
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        options.loop_vectorization = True
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
        missing = {
            f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")
        } - _FOREIGN
        if missing:
            raise RsgenError(
                f"kernel: machine code calls {', '.join(sorted(missing))}; allowed: functions of C"
            )
        return machine.emit_object(module), symbol


def load_object(code: bytes, symbol: str) -> Callable[..., Any]:
    """Load object code that ``compile_source`` made on a machine like this one.

    Raises
    ------
    RsgenError
        The code does not contain the symbol.
    """
    llvm = _llvm()
    with _compiler_lock:
        _, engine = _engine()
        address = engine.get_function_address(symbol)
        if not address:
            engine.add_object_file(llvm.ObjectFileRef.from_data(code))
            engine.finalize_object()
            address = engine.get_function_address(symbol)
    if not address:
        raise RsgenError(f"kernel: no {symbol} in its machine code")
    function = ctypes.CFUNCTYPE(ctypes.c_int32, _P, _P, *_ARGUMENTS)(address)
    # numba's own convention: places for the answer and for a fault come first; nothing is ever left there
    answer, fault = ctypes.c_void_p(), ctypes.c_void_p()
    return partial(function, ctypes.byref(answer), ctypes.byref(fault))


_FORMAT = "4"  # of the files; raise it when their layout changes

_loaded: dict[str, Callable[..., Any]] = {}
_lock = Lock()


def cache_folder() -> Path:
    """Where compiled kernels are stored: ``RSGEN_CACHE`` where it is set, else the user's cache folder."""
    chosen = os.environ.get("RSGEN_CACHE")
    if chosen:
        return Path(chosen)
    return Path(platformdirs.user_cache_dir("rsgen", appauthor=False))


def cache_fault() -> str | None:
    """Why kernels are compiled in every process instead of stored; None where the cache can be trusted."""
    try:
        with open_private_folder(cache_folder()) as folder:
            if not os.access(".", os.W_OK, dir_fd=folder.descriptor):
                raise UntrustedFolderError("it cannot be written")
            return None
    except UntrustedFolderError as fault:
        return f"{cache_folder()}: {fault}"


@lru_cache(maxsize=256)
def _key(source: str) -> str:
    parts = (_FORMAT, source, version("numba"), version("llvmlite"), *host(), sys.implementation.cache_tag)
    return hashlib.sha256("\n".join(str(part) for part in parts).encode()).hexdigest()[:32]


def _stored(key: str) -> tuple[bytes, str] | None:
    """Object code and symbol of a kernel; None where the cache has none that can be trusted."""
    try:
        with open_private_folder(cache_folder()) as folder:
            content = folder.read(key)
    except UntrustedFolderError:
        return None
    if content is None:
        return None
    symbol, _, code = content.partition(b"\0")
    return code, symbol.decode()


def _compiled(key: str, source: str) -> tuple[bytes, str]:
    """Compile a kernel and store it where that can be done; the code is good even if storing fails."""
    code, symbol = compile_source(source, f"rsgen_kernel_{key}")
    with suppress(UntrustedFolderError, OSError), open_private_folder(cache_folder()) as folder:
        folder.write(key, symbol.encode() + b"\0" + code)
    return code, symbol


def load_kernel(source: str) -> Callable[..., Any]:
    """Load the compiled entry of a kernel source; compile it first where the cache has none."""
    key = _key(source)
    with _lock:
        if key not in _loaded:
            _loaded[key] = load_object(*(_stored(key) or _compiled(key, source)))
        return _loaded[key]


# ----------------------------------------------------------------------------
# A law by its compiled kernel, and the arrays that it takes.

_WORK_NUMBERS = 1024 * 64
"""Numbers of work space: more rows of 64 points than any law that can be read needs."""

_space = threading.local()


@dataclass(frozen=True, slots=True, eq=False)
class Integrated:
    """Where k points are after some periods of the force.

    Parameters
    ----------
    state
        (R, k) y = (x, v/omega) [m], so that both parts weigh the same; then what a law remembers, as in
        ``MemoryRows``.
    history
        (2, D, k) the rows on which the motion depends smoothly, two periods and one period before.
    harmonics
        (k, H+1) complex displacement of the last period [m]; (k, 0) where none was recorded.
    peak
        (k, 2) largest and smallest displacement of the last period [m]; (0, 2) where none were recorded.
    """

    state: Array
    history: Array
    harmonics: ComplexArray
    peak: Array


@lru_cache(maxsize=32)
def _phases(steps: int) -> Array:
    angle = np.pi / steps * np.arange(2 * steps)
    return np.ascontiguousarray([np.cos(angle), np.sin(angle)])


def _address(array: NDArray[Any]) -> int:
    address: int = array.__array_interface__["data"][0]
    return address


def _work() -> Array:
    """Work space of one thread."""
    if not hasattr(_space, "rows"):
        _space.rows = np.zeros(_WORK_NUMBERS)
    rows: Array = _space.rows
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """The compiled law and the order of its parameters.

    Parameters
    ----------
    parameters
        Names in the order in which ``integrate`` takes their values.
    rows
        What stands in the rows of a state.
    """

    parameters: tuple[str, ...]
    rows: MemoryRows
    _enter: Callable[..., Any]

    def integrate(
        self,
        points: NDArray[np.intp],
        state: Array,
        force: Array,
        omega: Array,
        mass: float,
        values: Array,
        *,
        steps: int,
        periods: int,
        harmonics: int | None = None,
        peaks: bool = True,
    ) -> Integrated:
        """Integrate points over some periods of f(t) = Re F exp(i omega t), from t = 0.

        Parameters
        ----------
        points
            (k,) rows of ``force`` and ``omega``; a row may occur more than once.
        state
            (R, k) y = (x, v/omega) [m], then what the law remembers, at the start; left as it is. Without the
            stack of reversals (``MemoryRows.stack`` rows) the memory of Masing laws is a closed loop alone.
        force, omega
            (n, 2) real and imaginary part of F [N], and (n,) angular frequency [rad/s].
        mass
            m [kg].
        values
            (P,) values of the parameters [SI], ordered as ``parameters``.
        steps
            Steps in a period, at least 16.
        periods
            How many.
        harmonics
            Record the mean and harmonics 1 to this in the last period; None: record nothing.
        peaks
            Record the peaks, too.

        Raises
        ------
        RsgenError
            Shapes or types of the arrays do not belong together.
        """
        k, columns = len(points), 0 if harmonics is None else harmonics + 1
        size = self.rows.stack if len(state) == self.rows.stack else self.rows.count
        after = np.array(state, dtype=np.float64, order="C")
        history = np.empty((2, self.rows.smooth, k))
        waves = np.empty((k, columns), dtype=np.complex128)
        peak = np.empty((k if peaks and columns else 0, 2))
        rows = np.ascontiguousarray(points, dtype=np.int64)
        F, w = np.ascontiguousarray(force), np.ascontiguousarray(omega)
        p = np.ascontiguousarray(values)
        self._check(rows, after, size, F, w, p)
        self._enter(
            _address(rows), k, _address(after), size, _address(history), _address(F), _address(w), len(w),
            mass, _address(p), len(p), _address(_phases(steps)), steps, periods,
            _address(waves), 2 * columns, _address(peak), len(peak), _address(_work()),
        )  # fmt: skip
        return Integrated(after, history, waves, peak)

    def _check(self, rows: NDArray[np.int64], after: Array, size: int, F: Array, w: Array, p: Array) -> None:
        """Refuse arrays that do not belong together: machine code checks neither shapes nor types."""
        k = len(rows)
        if (
            after.shape != (size, k) or F.shape != (len(w), 2) or p.shape != (len(self.parameters),)
            or not all(a.dtype == np.float64 for a in (F, w, p))
            or (k and not (rows.min() >= 0 and rows.max() < len(w)))
        ):  # fmt: skip
            raise RsgenError(
                f"integrate: {k} points, states {after.shape}, forces {F.shape}, {len(w)} frequencies, "
                f"{len(p)} values do not belong together; (k,), ({size}, k), (n, 2), (n,) and (P,) of "
                "float64 are needed"
            )


def compile_kernel(
    force: sympy.Expr,
    *,
    values: Mapping[str, float] | None = None,
    locate_all: bool = False,
    coarse: bool = False,
) -> Kernel:
    """Compile a force law, or find it compiled.

    Parameters
    ----------
    force
        n(x, v) [N].
    values, locate_all, coarse
        As in ``generate``.

    Raises
    ------
    ExpressionError
        The law holds a function that no law may use.
    """
    source = generate(force, values=values, locate_all=locate_all, coarse=coarse)
    memory = memory_form(force)
    rows = MemoryRows(0, 0) if memory is None else MemoryRows(len(memory.rates), len(memory.curves))
    return Kernel(parameter_order(force), rows, load_kernel(source))
