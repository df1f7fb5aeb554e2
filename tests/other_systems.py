"""This machine without what another system lacks: for a process, and those that it starts, by `hidden_environment`.

Only our own code misses what is hidden: the standard library and the packages that we use have their own code for each
system. `filelock` is loaded first: on Windows it has locks of its own, which here stand for themselves.
"""

from __future__ import annotations

import builtins
import os
import signal
import sys
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
OURS: Final = tuple(f"{ROOT / name}{os.sep}" for name in ("app", "core", "labels"))


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


POSIX_MODULES: Final = _names("""
fcntl resource pwd grp termios tty pty curses readline syslog crypt spwd nis posix _posixsubprocess
""")
POSIX_OS: Final = _names("""
chown chroot confstr confstr_names copy_file_range ctermid eventfd eventfd_read eventfd_write fchdir fchmod fchown
fdatasync fork forkpty fpathconf fstatvfs getegid geteuid getgid getgrouplist getgroups getloadavg getpgid getpgrp
getpriority getrandom getresgid getresuid getsid getuid getxattr initgroups killpg lchown listxattr lockf login_tty
major makedev memfd_create minor mkfifo mknod nice openpty pathconf pathconf_names pidfd_open pipe2 posix_fadvise
posix_fallocate posix_spawn posix_spawnp posix_openpt pread preadv pwrite pwritev readv register_at_fork removexattr
sched_get_priority_max sched_get_priority_min sched_getaffinity sched_getparam sched_getscheduler
sched_rr_get_interval sched_setaffinity sched_setparam sched_setscheduler sched_yield sendfile setegid seteuid
setgid setgroups setpgid setpriority setregid setresgid setresuid setreuid setsid setuid setxattr splice statvfs
sync sysconf sysconf_names tcgetpgrp tcsetpgrp ttyname uname wait wait3 wait4 waitid writev O_ACCMODE O_ASYNC
O_CLOEXEC O_DIRECT O_DIRECTORY O_DSYNC O_LARGEFILE O_NDELAY O_NOATIME O_NOCTTY O_NOFOLLOW O_NONBLOCK O_PATH O_RSYNC
O_SYNC O_TMPFILE WCOREDUMP WEXITSTATUS WIFCONTINUED WIFEXITED WIFSIGNALED WIFSTOPPED WNOHANG WSTOPSIG WTERMSIG
WUNTRACED
""")
LINUX_OS: Final = _names("""
copy_file_range eventfd eventfd_read eventfd_write fdatasync getrandom getresgid getresuid getxattr listxattr
memfd_create pidfd_open pipe2 posix_fadvise posix_fallocate removexattr sched_getaffinity sched_getparam
sched_getscheduler sched_rr_get_interval sched_setaffinity sched_setparam sched_setscheduler setresgid setresuid
setxattr splice O_DIRECT O_LARGEFILE O_NOATIME O_PATH O_RSYNC O_TMPFILE
""")
WINDOWS_SIGNALS: Final = _names("SIGABRT SIGFPE SIGILL SIGINT SIGSEGV SIGTERM SIG_DFL SIG_IGN")
POSIX_SIGNAL: Final = _names("""
alarm getitimer pause pthread_kill pthread_sigmask setitimer siginterrupt sigpending sigtimedwait sigwait
sigwaitinfo
""")
LINUX_PLACES: Final = ("/proc", "/sys")


def hidden_environment(system: str, folder: Path) -> dict[str, str]:
    """The environment of a process that is to be like `windows` or `macos`; `folder` gets what makes it so."""
    text = f"import sys\nsys.path.append({str(ROOT)!r})\nfrom tests.other_systems import hide\nhide({system!r})\n"
    (folder / "sitecustomize.py").write_text(text, encoding="utf-8")
    path = os.pathsep.join([str(folder), str(ROOT)])
    return {**os.environ, "PYTHONPATH": path}


def hide(system: str) -> None:
    """From now on our code does not find what this system lacks."""
    import filelock  # noqa: F401 (see above)

    if system == "windows":
        signals = {name for name in vars(signal) if name.startswith("SIG") and name not in WINDOWS_SIGNALS}
        _hide_from_imports(
            POSIX_MODULES, {"os": _without(os, POSIX_OS, name="nt"), "signal": _without(signal, POSIX_SIGNAL | signals)}
        )
    else:
        _hide_from_imports(frozenset(), {"os": _without(os, LINUX_OS)})
    sys.addaudithook(_refuse_linux_places)


def _without(module: types.ModuleType, names: frozenset[str] | set[str], **instead: object) -> types.ModuleType:
    found = types.ModuleType(module.__name__)
    vars(found).update({name: value for name, value in vars(module).items() if name not in names} | instead)
    return found


def _hide_from_imports(modules: frozenset[str], replaced: Mapping[str, types.ModuleType]) -> None:
    imported = builtins.__import__

    def guarded(name: str, globals=None, locals=None, fromlist=(), level: int = 0):  # noqa: A002
        if level == 0 and str((globals or {}).get("__file__", "")).startswith(OURS):
            root = name.partition(".")[0]
            if root in modules:
                raise ModuleNotFoundError(f"No module named {root!r}", name=root)
            if root in replaced and (name == root or not fromlist):
                return replaced[root]
        return imported(name, globals, locals, fromlist, level)

    builtins.__import__ = guarded


def _refuse_linux_places(event: str, arguments: tuple) -> None:
    """What Linux alone shows as files is not there for our code."""
    if event not in ("open", "os.listdir", "os.scandir") or not str(arguments[0]).startswith(LINUX_PLACES):
        return
    frame = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.endswith(("pathlib.py", "<frozen os>", "os.py")):
        frame = frame.f_back
    if frame is not None and frame.f_code.co_filename.startswith(OURS):
        raise FileNotFoundError(2, "No such file or directory", str(arguments[0]))
