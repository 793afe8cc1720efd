"""Check the binaries: their folders, platforms, exported functions and needed libraries."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import PurePosixPath

from cosim.fmu.inspect.declared_model import DeclaredModel
from cosim.fmu.inspect.findings import Finding, finding, first_few
from cosim.fmu.inspect.fmi_functions import functions
from cosim.fmu.inspect.image import Image
from cosim.fmu.inspect.library import Binary
from cosim.fmu.inspect.platforms import FMI2, Machine, named_by_tuple, this_libc, this_machine
from cosim.fmu.inspect.rules import Level

ROOT = "binaries/"
_SUFFIXES = (".so", ".dll", ".dylib")
_SYSTEM = re.compile(
    # Linux: the C library, its parts, and the compiler's; what every distribution has
    r"(lib(c|m|dl|rt|pthread|util|resolv|gcc_s|stdc\+\+|atomic|gomp|gfortran|quadmath)\.so(\.\d+)*"
    r"|ld-linux.*\.so\.\d|linux-vdso\.so\.\d"
    # Windows: API sets, and the runtimes that come with it or by the redistributable
    r"|(api|ext)-ms-win-.*\.dll|(vcruntime|msvcp|msvcr|concrt|vcomp|vccorlib|mfc|atl)\d+\w*\.dll"
    # macOS
    r"|/usr/lib/.*|/System/Library/.*)",
    re.IGNORECASE,
)
# the system's own libraries, in every desktop and server Windows since 7
_WINDOWS = frozenset(
    """
    activeds advapi32 authz avicap32 avifil32 avrt bcrypt bcryptprimitives cabinet cfgmgr32
    clusapi combase comctl32 comdlg32 credui crypt32 cryptbase cryptnet cryptsp cryptui d2d1
    d3d10 d3d10_1 d3d11 d3d12 d3d8 d3d9 d3dcompiler_47 davclnt dbgeng dbghelp dciman32 dcomp
    ddraw devobj dhcpcsvc dinput dinput8 dnsapi drvstore dsound dsprop dsrole dwmapi dwrite dxgi
    dxva2 esent evr faultrep fltlib fwpuclnt gdi32 gdiplus glu32 hid hlink httpapi icmp imagehlp
    imm32 iphlpapi kernel32 kernelbase ktmw32 loadperf logoncli lz32 mapi32 mf mfplat
    mfreadwrite mpr mprapi msacm32 mscms mscoree msdmo msi msimg32 msvcirt msvcrt msvfw32
    mswsock ncrypt ndfapi netapi32 netutils newdev normaliz ntdll ntdsapi odbc32 odbccp32 ole32
    oleacc oleaut32 oledlg opengl32 pdh powrprof propsys psapi quartz rasapi32 resutils rpcns4
    rpcrt4 rstrtmgr rtutils samcli schannel secur32 sensapi setupapi sfc shcore shell32 shfolder
    shlwapi slc snmpapi srvcli sspicli sti tapi32 tbs tdh traffic ucrtbase urlmon user32 userenv
    usp10 uxtheme version virtdisk vssapi webservices wer wevtapi winbrand windowscodecs winhttp
    wininet winmm winscard winspool winsta wintrust wlanapi wldap32 ws2_32 wscapi wsock32
    wtsapi32 xinput1_4 xmllite xpsprint
    """.split()  # noqa: SIM905 - one name to a line is a page
)
_DEBUG = re.compile(
    r"(ucrtbased|(msvcp|msvcr|vcruntime|concrt|vccorlib|mfc)\d+(_\d)?u?d)\.dll", re.IGNORECASE
)
_BESIDE = re.compile(r"\$ORIGIN|\$\{ORIGIN\}|@loader_path|@rpath")
_MANY_SYMBOLS = 20
_OLD_LIBC = (2, 28)  # of systems that are still maintained in 2025


def binary_entries(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return (folder, path) of every library below binaries/<folder>/."""
    found = []
    for name in sorted(names):
        parts = name.split("/")
        if name.startswith(ROOT) and len(parts) >= 3 and name.endswith(_SUFFIXES):
            found.append((parts[1], name))
    return found


def platform_of(folder: str) -> Machine | None:
    """Return the platform of a folder named as in FMI 1 and 2 or as in FMI 3."""
    return FMI2.get(folder) or named_by_tuple(folder)


def missing_binary() -> str:
    """Say for which machine there is no binary: this one."""
    machine = this_machine()
    return f"no binary for {machine.architecture} {machine.system}"


def binary_findings(
    model: DeclaredModel, names: Sequence[str], binaries: Sequence[Binary], *, sources: bool
) -> Iterator[Finding]:
    """Check the folders of binaries and their content."""
    inside: Mapping[str, set[str]] = defaultdict(set)
    for name in names:
        parts = name.split("/")
        if name.startswith(ROOT) and len(parts) >= 3:
            inside[parts[1]].add("/".join(parts[2:]))
    identifiers = {i.identifier for i in model.interfaces if i.identifier}
    if not inside:
        code = "binary-sources-only" if sources else "binary-none"
        what = "sources" if sources else "neither binaries nor sources"
        yield finding(code, ROOT, f"there are {what}")
    here = False
    for folder, files in sorted(inside.items()):
        yield from _folder(folder, model.major)
        built_for = platform_of(folder)
        if built_for is None:
            continue
        wanted = {identifier + built_for.suffix for identifier in identifiers}
        here = here or (built_for == this_machine() and wanted <= files)
        for name in sorted(wanted - files):
            got = first_few(sorted(files))
            what = f"{name} is missing; there is {got}"
            # the file systems of Windows and macOS find it all the same
            by_case = built_for.system != "linux" and name.lower() in map(str.lower, files)
            level: Level | None = "warning" if by_case else None
            yield finding("binary-name", ROOT + folder, what, level=level)
    if inside and not here:
        yield finding("binary-here", ROOT, missing_binary())
    for binary in binaries:
        yield from _binary(model, binary, inside[binary.folder])
    yield from _unexamined(binaries)


def _unexamined(binaries: Sequence[Binary]) -> Iterator[Finding]:
    """Say once which readers are not installed."""
    missing = sorted({binary.unexamined for binary in binaries if binary.unexamined is not None})
    if missing:
        yield finding("binary-unexamined", ROOT, f"not installed: {', '.join(missing)}")


def _folder(folder: str, major: int) -> Iterator[Finding]:
    where = ROOT + folder
    if folder in FMI2:
        if major == 3:
            what = f"FMI 3 calls it {FMI2[folder].architecture}-{FMI2[folder].system}"
            yield finding("binary-folder", where, what)
    elif named_by_tuple(folder) is None:
        yield finding("binary-folder", where, f"{folder!r} is not the name of a platform")
    elif major < 3:
        yield finding("binary-folder-tuple", where, "a folder named as in FMI 3")


def _binary(model: DeclaredModel, binary: Binary, beside: set[str]) -> Iterator[Finding]:
    where = binary.name
    if binary.unexamined is not None:
        return
    if binary.damage is not None:
        yield finding("binary-damaged", where, binary.damage)
        return
    if binary.unread is not None:
        yield finding("binary-unread", where, binary.unread)
        return
    expected = platform_of(binary.folder)
    image = next((i for i in binary.images if i.platform == expected), None)
    if image is None:
        if expected is not None:
            built = ", ".join(
                f"{i.platform.architecture} {i.platform.system}" for i in binary.images
            )
            yield finding("binary-platform", where, f"{binary.images[0].format} for {built}")
        image = binary.images[0]
    stem = PurePosixPath(binary.name).stem
    interfaces = [i for i in model.interfaces if i.identifier == stem]
    if interfaces and not (model.major == 3 and binary.folder in FMI2):  # where no tool looks
        yield from _exports(model, binary, image)
        if image.needs_python:
            declared = all(i.is_true("needsExecutionTool") for i in interfaces)
            count = sum(name.startswith(("Py", "_Py")) for name in image.imports)
            what = f"it takes {count} functions from a Python interpreter"
            yield finding("needs-python", where, what, level="note" if declared else "warning")
    yield from _needs(binary, image, beside)


def _exports(model: DeclaredModel, binary: Binary, image: Image) -> Iterator[Finding]:
    stem = PurePosixPath(binary.name).stem
    if image.exports is None:
        what = "its symbols are stripped: its functions were not checked"
        yield finding("binary-unexamined", binary.name, what)
        return
    core: set[str] = set()
    others: set[str] = set()
    for interface in model.interfaces:
        if interface.identifier == stem:
            wanted = functions(model.major, interface.kind, stem)
            core |= wanted.core
            others |= wanted.others
    for name in sorted(core - image.exports):
        yield finding("function-missing", binary.name, f"{name} is not exported")
    if absent := sorted(others - core - image.exports):
        what = f"{len(absent)} functions are not exported: {', '.join(absent[:6])}"
        yield finding("function-optional", binary.name, what)
    foreign = image.exports - image.functions
    if len(foreign) > _MANY_SYMBOLS and image.format != "PE":
        what = f"it exports {len(foreign)} symbols besides FMI's"
        yield finding("symbols-open", binary.name, what)


def _needs(binary: Binary, image: Image, beside: set[str]) -> Iterator[Finding]:
    where = binary.name
    present = {name.lower() for name in beside}
    for library in image.libraries:
        yield from _library(where, image, library, present)
    for path in image.search:
        if path.startswith("/"):
            yield finding("library-path", where, f"it looks for libraries in {path}")
    if image.libc is not None and image.libc > _OLD_LIBC:
        version = ".".join(map(str, image.libc))
        yield finding("libc-version", where, f"it needs glibc {version} or newer")
        here = this_libc()
        if here is not None and image.platform == this_machine() and image.libc > here:
            have = ".".join(map(str, here))
            yield finding("libc-here", where, f"it needs glibc {version}, this machine has {have}")
    if image.executable_stack:
        yield finding("stack-executable", where, "it asks for an executable stack")


def _library(where: str, image: Image, library: str, present: set[str]) -> Iterator[Finding]:
    """Check a needed library: part of the system, packed beside the binary, or missing."""
    base = PurePosixPath(library).name
    if _DEBUG.fullmatch(base):
        yield finding("library-debug", where, f"it needs {base}")
    elif _SYSTEM.fullmatch(library) or _is_of_windows(base.lower()):
        return
    elif base.lower() in present:
        on_search_path = any(_BESIDE.search(path) for path in (*image.search, library))
        if image.format != "PE" and not on_search_path:
            yield finding("library-unreached", where, f"{base} is packed beside it")
    elif library.startswith("/"):
        yield finding("library-path", where, f"it needs {library}")
    elif "python" in base.lower():
        yield finding("needs-python", where, f"it needs {base} of the system", level="note")
    else:
        yield finding("library-absent", where, f"it needs {base}")


def _is_of_windows(name: str) -> bool:
    """Whether a library, named in small letters, is a part of Windows."""
    stem, _, suffix = name.rpartition(".")
    return suffix in ("dll", "drv", "ocx") and stem in _WINDOWS
