#!/usr/bin/env python3
"""Runs a command under a unit's own environment, limits and sandbox where systemd is not running (containers, CI).

    systemd/as_unit.py systemd/irsd.service --state DIR [--write DIR ...] [--strict] -- COMMAND ...

Taken from the unit: Environment, UMask, Nice, LimitMEMLOCK, TasksMax, CPUQuota and MemoryMax (where control groups can be written),
NoNewPrivileges, SystemCallFilter, SystemCallErrorNumber, RestrictAddressFamilies, RestrictNamespaces; as root also User (nobody where
there is no such user), CapabilityBoundingSet, ProtectSystem=strict, PrivateTmp, StateDirectory and CacheDirectory. What can't be done
here is said on stderr. --strict: a system call that the filter forbids ends the process, where the unit would let it fail.
Only the standard library; Linux on x86-64.
"""

from __future__ import annotations

import argparse
import ctypes
import errno
import os
import pwd
import re
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

_PR_SET_NO_NEW_PRIVS, _PR_SET_SECCOMP, _PR_CAPBSET_DROP = 38, 22, 24
_CLONE_NEWNS, _LAST_CAPABILITY = 0x20000, 40
_NAMESPACES = 0x02000000 | 0x04000000 | 0x08000000 | 0x10000000 | 0x20000000 | 0x40000000 | _CLONE_NEWNS
_ALLOW, _ERRNO, _KILL = 0x7FFF0000, 0x00050000, 0x80000000
_ARCH_X86_64 = 0xC000003E
_LD, _JEQ, _JSET, _RET = 0x20, 0x15, 0x45, 0x06
_NUMBERS = ("/usr/include/x86_64-linux-gnu/asm/unistd_64.h", "/usr/include/asm/unistd_64.h")

Unit = dict[str, list[str]]


def read_unit(path: Path) -> Unit:
    """The section [Service]: key -> values in their order. An empty value empties the list, as in systemd."""
    unit: Unit = {}
    section = ""
    for line in path.read_text().splitlines():
        text = line.strip()
        if text.startswith("["):
            section = text
        elif section == "[Service]" and "=" in text and not text.startswith(("#", ";")):
            key, _, value = text.partition("=")
            unit[key] = [*unit.get(key, []), value] if value else [""]
    return unit


def environment(unit: Unit) -> dict[str, str]:
    """What Environment= sets."""
    words = [word for value in unit.get("Environment", []) for word in value.split()]
    return dict(word.split("=", 1) for word in words)


def allowed_calls(unit: Unit) -> set[str] | None:
    """Names of the system calls that SystemCallFilter= leaves; None without a filter."""
    calls: set[str] | None = None
    for value in unit.get("SystemCallFilter", []):
        denied = value.startswith("~")
        names: set[str] = set()
        for word in value.lstrip("~").split():
            names |= _members(word) if word.startswith("@") else {word}
        if calls is None:
            calls = _members("@default") | names if not denied else _members("@known") - names
        else:
            calls = calls - names if denied else calls | names
    return calls


def _members(group: str) -> set[str]:
    """The calls in a group of systemd, groups in it resolved."""
    said = subprocess.run(
        ["systemd-analyze", "--no-pager", "syscall-filter", group], check=True, capture_output=True, text=True
    ).stdout
    names: set[str] = set()
    for line in said.splitlines()[1:]:
        word = line.strip()
        if word.startswith("@"):
            names |= _members(word)
        elif word and not word.startswith("#"):
            names.add(word)
    return names


def call_numbers() -> dict[str, int]:
    """Number of each system call by name, of the kernel's headers. Raises OSError where there are none."""
    path = next((Path(name) for name in _NUMBERS if Path(name).is_file()), None)
    if path is None or os.uname().machine != "x86_64":
        raise OSError("no numbers of system calls: linux-libc-dev on x86-64 has them")
    found = re.findall(r"#define __NR_(\w+)\s+(\d+)", path.read_text())
    return {name: int(number) for name, number in found}


def seccomp_program(unit: Unit, numbers: dict[str, int], strict: bool) -> bytes:
    """The filter of the unit as BPF instructions."""
    named = (unit.get("SystemCallErrorNumber") or [""])[-1]
    denied = _KILL if strict or not named else _ERRNO | getattr(errno, named)
    code: list[tuple[int, int, int, int]] = [
        (_LD, 0, 0, 4),
        (_JEQ, 1, 0, _ARCH_X86_64),
        (_RET, 0, 0, _KILL),
        (_LD, 0, 0, 0),
    ]

    def answer(name: str, body: list[tuple[int, int, int, int]]) -> None:
        if name in numbers:
            code.append((_JEQ, 0, len(body), numbers[name]))
            code.extend(body)

    if (unit.get("RestrictNamespaces") or ["no"])[-1] == "yes":
        answer("clone3", [(_RET, 0, 0, _ERRNO | errno.ENOSYS)])  # its flags can't be seen: glibc takes clone instead
        answer(
            "clone",
            [(_LD, 0, 0, 16), (_JSET, 0, 1, _NAMESPACES), (_RET, 0, 0, _ERRNO | errno.EPERM), (_RET, 0, 0, _ALLOW)],
        )
        for name in ("unshare", "setns"):
            answer(name, [(_RET, 0, 0, _ERRNO | errno.EPERM)])
    families = " ".join(unit.get("RestrictAddressFamilies", [])).split()
    if families:
        import socket  # noqa: PLC0415

        body = [(_LD, 0, 0, 16)]
        for family in families:
            body += [(_JEQ, 0, 1, int(getattr(socket, family))), (_RET, 0, 0, _ALLOW)]
        answer("socket", [*body, (_RET, 0, 0, _KILL if strict else _ERRNO | errno.EAFNOSUPPORT)])
    calls = allowed_calls(unit)
    for name in sorted(calls or ()):
        answer(name, [(_RET, 0, 0, _ALLOW)])
    code.append((_RET, 0, 0, denied if calls is not None else _ALLOW))
    return b"".join(struct.pack("<HBBI", *instruction) for instruction in code)


def load_filter(program: bytes) -> None:
    """Puts the calling process, and all it starts, under the filter."""
    libc = ctypes.CDLL(None, use_errno=True)
    buffer = ctypes.create_string_buffer(program, len(program))
    filter_of = struct.pack("<HxxxxxxQ", len(program) // 8, ctypes.addressof(buffer))
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) or libc.prctl(_PR_SET_SECCOMP, 2, filter_of, 0, 0):
        raise OSError(ctypes.get_errno(), "the kernel does not take the filter")


def shut_file_system(unit: Unit, state: Path, writable: list[Path], program: str) -> None:
    """All read-only but the unit's own directories, ``writable``, and a /tmp of its own. Needs root; a mount namespace of its own."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWNS):
        raise OSError(ctypes.get_errno(), "no mount namespace")

    def mount(*arguments: object) -> None:
        subprocess.run(["mount", *map(str, arguments)], check=True)

    mount("--make-rprivate", "/")
    kept = [(folder, folder) for folder in writable]
    for key, parent in (("StateDirectory", "/var/lib"), ("CacheDirectory", "/var/cache")):
        for name in " ".join(unit.get(key, [])).split():
            source = state / key / name
            source.mkdir(parents=True, exist_ok=True)
            kept.append((source, Path(parent) / name))
    hold = Path(tempfile.mkdtemp(dir="/dev/shm"))
    for number, (source, _) in enumerate(kept):
        (hold / str(number)).mkdir()
        mount("--bind", source, hold / str(number))
    for parent, mode in (("/var/lib", "0755"), ("/var/cache", "0755"), ("/tmp", "1777")):
        mount("-t", "tmpfs", "-o", f"mode={mode}", "tmpfs", parent)
    for _, place in kept:
        place.mkdir(parents=True, exist_ok=True)
    mount("-o", "bind,remount,ro", "/")
    owner = user_of(unit) if _may_run(user_of(unit), program) else pwd.getpwuid(0)
    for number, (_, place) in enumerate(kept):
        mount("--bind", hold / str(number), place)
        mount("-o", "bind,remount,rw", place)
        for path in (place, *place.rglob("*")):
            os.chown(path, owner.pw_uid, owner.pw_gid)


def user_of(unit: Unit) -> pwd.struct_passwd:
    """The unit's user, or nobody."""
    try:
        return pwd.getpwnam((unit.get("User") or ["nobody"])[-1])
    except KeyError:
        return pwd.getpwnam("nobody")


def limit(unit: Unit, name_of_unit: str) -> None:
    """Nice, resource limits, and control groups where they can be written."""
    os.nice(int((unit.get("Nice") or ["0"])[-1]))
    memlock = (unit.get("LimitMEMLOCK") or [""])[-1]
    if memlock:
        try:
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (_bytes(memlock), _bytes(memlock)))
        except ValueError as error:
            say(f"no LimitMEMLOCK: {error}")
    tasks = (unit.get("TasksMax") or [""])[-1]
    quota = (unit.get("CPUQuota") or [""])[-1].rstrip("%")
    memory = (unit.get("MemoryMax") or [""])[-1]
    wanted = (
        ("cpu", "cpu.cfs_quota_us", str(int(quota) * 1000) if quota else ""),
        ("memory", "memory.limit_in_bytes", str(_bytes(memory)) if memory else ""),
        ("pids", "pids.max", tasks),
    )
    for controller, name, value in wanted:
        group = Path("/sys/fs/cgroup") / controller / f"as-unit-{name_of_unit}"
        if not value:
            continue
        try:
            group.mkdir(exist_ok=True)
            (group / name).write_text(value)
            (group / "cgroup.procs").write_text(str(os.getpid()))
        except OSError as error:
            say(f"no limit {name}: {error.strerror}")


def _bytes(text: str) -> int:
    return int(float(text.rstrip("KMG")) * {"K": 2**10, "M": 2**20, "G": 2**30}.get(text[-1], 1))


def drop_rights(unit: Unit, program: str) -> bool:
    """No capability to be had, and the unit's user. Needs root. False when the user could not be changed."""
    libc = ctypes.CDLL(None, use_errno=True)
    if "CapabilityBoundingSet" in unit and not "".join(unit["CapabilityBoundingSet"]):
        for capability in range(_LAST_CAPABILITY + 1):
            libc.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
    user = user_of(unit)
    if not _may_run(user, program):
        say(f"{program} is out of {user.pw_name}'s reach: it runs as root without any capability")
        return False
    os.setgroups([])
    os.setgid(user.pw_gid)
    os.setuid(user.pw_uid)
    return True


def _may_run(user: pwd.struct_passwd, program: str) -> bool:
    """Whether the user may execute the program and what interprets it, asked by becoming the user."""
    path = Path(shutil.which(program) or program)
    with path.open("rb") as file:
        first = file.readline(256)
    needed = [path, *([first[2:].split()[0].decode()] if first.startswith(b"#!") else [])]
    child = os.fork()
    if child == 0:
        os.setgroups([])
        os.setgid(user.pw_gid)
        os.setuid(user.pw_uid)
        os._exit(0 if all(os.access(each, os.X_OK) for each in needed) else 1)
    return os.waitpid(child, 0)[1] == 0


def say(text: str) -> None:
    sys.stderr.write(f"as_unit: {text}\n")


def main() -> None:
    """Parses, prepares, and becomes the command."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("unit", type=Path)
    parser.add_argument("--state", type=Path, required=True, help="stands for /var/lib and /var/cache")
    parser.add_argument("--write", type=Path, action="append", default=[], help="a folder that may be written besides")
    parser.add_argument("--strict", action="store_true", help="a forbidden system call ends the process")
    parser.add_argument("command", nargs="+")
    given = parser.parse_args()
    unit = read_unit(given.unit)
    state, writable = given.state.resolve(), [folder.resolve() for folder in given.write]
    state.mkdir(parents=True, exist_ok=True)
    numbers = call_numbers()
    program = seccomp_program(unit, numbers, given.strict)
    os.environ.update(environment(unit))
    names = " ".join(unit.get("StateDirectory", [])).split()
    os.environ["STATE_DIRECTORY"] = ":".join(f"/var/lib/{name}" for name in names)
    limit(unit, given.unit.stem)
    if os.getuid() == 0:
        for folder in writable:
            folder.mkdir(parents=True, exist_ok=True)
        shut_file_system(unit, state, writable, given.command[0])
        os.environ["HOME"] = "/var/lib/irsd"
    else:
        os.environ["STATE_DIRECTORY"] = str(state)
        os.environ.pop("NUMBA_CACHE_DIR", None)
        say("not root: no file system, user and capabilities of the unit")
    os.umask(int((unit.get("UMask") or ["0022"])[-1], 8))
    if os.getuid() == 0 and not drop_rights(unit, given.command[0]):
        # SQLite gives its files to the owner of the database, when it finds that it is root
        unit["SystemCallFilter"] = [*unit.get("SystemCallFilter", []), "fchown"]
        program = seccomp_program(unit, numbers, given.strict)
    load_filter(program)
    os.execvp(given.command[0], given.command)


if __name__ == "__main__":
    main()
