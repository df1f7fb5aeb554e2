"""Whether the numeric tests hold however a processor rounds: run them as if on other processors, and print a table.

    python -m benchmarks.rounding [--paths PATH ...] [--quick]

Sums in another order, fused multiplications and other tables for sines give other last digits. No test may depend on
them: those marked `numeric` are run once for each setting, in a process of its own.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
TORCH_OLD: Final = "ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 MKL_ENABLE_INSTRUCTIONS=SSE4_2"
TORCH_AVX2: Final = "ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 MKL_ENABLE_INSTRUCTIONS=AVX2"
"""torch's own kernels, and those of the libraries that it calls."""
NUMBA_OLD: Final = "NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES="
THREADS: Final = "OMP_NUM_THREADS={0} MKL_NUM_THREADS={0} OPENBLAS_NUM_THREADS={0} NUMBA_NUM_THREADS={0}"
"""torch takes its number from OMP_NUM_THREADS and MKL_NUM_THREADS."""
NO_AVX512: Final = "NPY_DISABLE_CPU_FEATURES=X86_V4,AVX512_ICL,AVX512_SPR OPENCV_CPU_DISABLE=AVX512-SKX"
NO_AVX: Final = (
    "NPY_DISABLE_CPU_FEATURES=X86_V3,X86_V4,AVX512_ICL,AVX512_SPR OPENCV_CPU_DISABLE=AVX512-SKX,AVX2,FP16,AVX "
    "GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"  # of the C library: sines, powers
)


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of the table."""

    name: str
    variables: str
    needs: tuple[str, ...] = ()
    """Flags of the processor, as /proc/cpuinfo names them."""
    quick: bool = False

    def environment(self, kernels: str) -> dict[str, str]:
        """The variables, and a folder for kernels that are compiled for another processor."""
        own = dict(variable.split("=", 1) for variable in self.variables.split())
        return own | ({"NUMBA_CACHE_DIR": kernels} if "NUMBA_CPU_NAME" in own else {})


SETTINGS: Final = (
    Setting("as it is", ""),
    Setting("torch default", TORCH_OLD),
    Setting("torch avx2", TORCH_AVX2, ("avx2",)),
    Setting("torch avx512", "ATEN_CPU_CAPABILITY=avx512", ("avx512f",)),
    Setting("OpenBLAS Haswell", "OPENBLAS_CORETYPE=Haswell", ("avx2", "fma")),
    Setting("OpenBLAS SkylakeX", "OPENBLAS_CORETYPE=SkylakeX", ("avx512f",)),
    Setting("OpenBLAS Zen", "OPENBLAS_CORETYPE=Zen", ("avx2", "fma")),
    Setting("numba generic", NUMBA_OLD),
    Setting("1 thread", THREADS.format(1)),
    Setting("2 threads", THREADS.format(2), quick=True),
    Setting("all without AVX-512", f"{TORCH_AVX2} OPENBLAS_CORETYPE=Haswell {NO_AVX512}", ("avx512f",), quick=True),
    Setting("all without AVX", f"{TORCH_OLD} {NUMBA_OLD} OPENBLAS_CORETYPE=Nehalem {NO_AVX}", quick=True),
)


def processor_flags() -> set[str]:
    """What the processor can do; empty where that is not known."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"^flags\s*: (.*)$", info.read_text("utf-8"), re.MULTILINE) if info.exists() else None
    return set(found[1].split()) if found else set()


def run_tests(environment: dict[str, str], paths: Sequence[str]) -> tuple[int, int, str]:
    """How many passed and failed, and the names of failures."""
    # Kernels of another processor are compiled in the first test that needs them: minutes.
    how = ("-n", "0", "-q", "-m", "numeric", "--timeout", "1200", "-rfE", "--tb=no")
    command = [sys.executable, "-m", "pytest", *how, *paths]
    ended = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **environment}, capture_output=True, encoding="utf-8", check=False
    )
    names = re.findall(r"^(?:FAILED|ERROR) (\S+)", ended.stdout, re.MULTILINE)
    passed = re.search(r"(\d+) passed", ended.stdout)
    if ended.returncode and not names:
        names = ["pytest: " + ((ended.stderr or ended.stdout).strip().splitlines() or ["no output"])[-1]]
    return int(passed[1]) if passed else 0, len(names), ", ".join(names)


def main() -> int:
    """The command line; ends with 1 if a test failed."""
    parser = argparse.ArgumentParser(description="The numeric tests as on other processors.")
    parser.add_argument("--paths", nargs="+", default=["tests"], metavar="PATH", help="tests; all by default")
    parser.add_argument("--quick", action="store_true", help="the three settings that differ most")
    arguments = parser.parse_args()
    flags, bad = processor_flags(), 0
    print(f"{platform.processor() or platform.machine()}\n{'setting':20}  passed  failed", flush=True)
    with tempfile.TemporaryDirectory(prefix="rounding-") as kernels:
        for setting in (one for one in SETTINGS if one.quick or not arguments.quick):
            if missing := sorted(set(setting.needs) - flags):
                print(f"{setting.name:20}  not here: the processor has no {', '.join(missing)}", flush=True)
                continue
            passed, failed, names = run_tests(setting.environment(kernels), arguments.paths)
            print(f"{setting.name:20}  {passed:6d}  {failed:6d}  {names}".rstrip(), flush=True)
            bad += failed
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
