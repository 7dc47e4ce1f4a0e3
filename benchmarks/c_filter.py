"""Size and time of the exported C filter on a Cortex-M7: ``python -m benchmarks.c_filter``.

Flash and memory are those of ``arm-none-eabi-gcc -O2``, without the mathematical library's ``sin``, ``cos``, ``expm1``.
Instructions are counted by ``qemu-system-arm`` (board mps2-an500, one instruction a nanosecond), not estimated. QEMU
knows no pipeline: cycles are instructions over the instructions a cycle that ``llvm-mca`` expects of the propagation's
code on a Cortex-M7 when every load hits; flash wait states and cache misses come on top.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from schuler.cli import demo
from schuler.export import filter_design
from schuler.export.folder import write_sources
from schuler.export.simulated import simulated_run
from schuler.files import read_toml
from schuler.navigation.config import NavigationConfig

_CPU = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
_SOURCES = ("mechanization.c", "covariance.c", "update.c", "gate.c", "filter.c", "schuler_config.c")
#: Vector table, FPU on, ticks of 40 ns (25 MHz), numbers to the terminal by semihosting.
_BOARD = r"""
#include <stdint.h>
#include "schuler_nav.h"
extern uint32_t stack_top;
void start(void);
static void call(int what, const void *argument)
{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}
static void stop(void)
{
    const uint32_t exit[2] = {0x20026, 0};
    call(0x20, exit);
    for (;;) {}
}
__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &stack_top, (void *)start, (void *)stop, (void *)stop, (void *)stop, (void *)stop};
static void print(uint32_t x)
{
    char text[12], *p = text + 11;
    *p = 0;
    do { *--p = (char)('0' + x % 10); x /= 10; } while (x);
    call(4, p);
    call(4, " ");
}
static sch_state s;
static sch_initial initial;
static volatile uint32_t *const tick = (volatile uint32_t *)0xE000E018;
static uint32_t begin;
static void from(void) { begin = *tick; }
static uint32_t took(void) { return ((begin - *tick) & 0xFFFFFF) * 40; }
static __attribute__((noinline)) void measure(void)
{
    const double llh[3] = {0.84, 0.2, 500.0};
    const sch_real v[3] = {10, 2, 0}, q[4] = {1, 0, 0, 0}, a[3] = {0.01, 0.01, 0.05};
    const sch_real b[3] = {0.1, 0.1, 0.1}, c[3] = {1, 1, 2};
    const sch_real R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, turn[3] = {1e-4f, 2e-4f, 1e-3f};
    const sch_real push[3] = {1e-3f, 0.02f, -0.0981f};
    uint32_t plain = 0, most = 0, all = 0, ns, fix, speed;
    double t = 0;
    int k;
    *(volatile uint32_t *)0xE000E014 = 0xFFFFFF;
    *(volatile uint32_t *)0xE000E018 = 0;
    *(volatile uint32_t *)0xE000E010 = 5;
    sch_initial_from_sigmas(&initial, 0, llh, v, q, a, b, c);
    sch_init(&s, &initial);
    for (k = 1; k <= 100; k++) {
        t = 0.01 * k;
        from();
        sch_imu(&s, t, turn, push);
        ns = took();
        all += ns;
        if (k == 15) plain = ns;
        if (ns > most) most = ns;
    }
    /* the sample before has propagated: what a fix adds is its update and one more propagation */
    sch_position(&s, t + 0.004, s.r_eb_e, R);
    sch_velocity(&s, t + 0.004, v, R);
    from();
    sch_imu(&s, t + 0.01, turn, push);
    fix = took();
    sch_odometer(&s, t + 0.02, 10, 1);
    from();
    sch_imu(&s, t + 0.02, turn, push);
    speed = took();
    print(plain); print(most); print(all / 100); print(fix); print(speed); print(sizeof s);
}
void start(void)
{
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* before any code that uses the floating-point unit */
    __asm__ volatile("dsb\n isb" ::: "memory");
    measure();
    stop();
}
"""
_LINK = """
MEMORY { FLASH : ORIGIN = 0, LENGTH = 4M  RAM : ORIGIN = 0x20000000, LENGTH = 4M }
stack_top = ORIGIN(RAM) + LENGTH(RAM);
SECTIONS {
  .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.ARM.ex*) } > FLASH
  .data : { *(.data*) *(.bss*) *(COMMON) } > RAM
}
"""
_IMU = {name: read_toml(Path(demo.__file__).with_name("demo.toml"))["imu"][name] for name in ("gyro", "accel")}
#: Rows of the table: name, and what the configuration has beside the IMU and loose coupling.
_ROWS = (
    ("15", {"filter": {"states": 15}}),
    ("18, wheels", {"filter": {"states": 15}, "aiding": {"non_holonomic": {}, "odometer": {}, "zero_velocity": {}}}),
    ("21", {"filter": {"states": 21}}),
    ("33", {"filter": {"states": 33}}),
)


def _run(*command: str, folder: Path) -> str:
    return subprocess.run(
        command, cwd=folder, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60
    ).stdout


def measured(folder: Path, flags: tuple[str, ...]) -> dict[str, float]:
    """Bytes, instructions and cycles of the filter in a folder."""
    gcc = ("arm-none-eabi-gcc", "-std=c99", "-O2", "-ffp-contract=off", *_CPU, *flags)
    _run(*gcc, "-fstack-usage", "-c", *_SOURCES, folder=folder)
    sizes = _run("arm-none-eabi-size", *(Path(name).with_suffix(".o").name for name in _SOURCES), folder=folder)
    stack = [int(line.split()[-2]) for path in folder.glob("*.su") for line in path.read_text().splitlines()]
    (folder / "board.c").write_text(_BOARD)
    (folder / "board.ld").write_text(_LINK)
    _run(
        *gcc, "-std=gnu99", "-o", "board.elf", *_SOURCES, "board.c", "-nostartfiles", "-Wl,-T,board.ld",
        "-Wl,--gc-sections", "-lm", "-lc", "-lnosys", folder=folder,
    )  # fmt: skip
    counted = _run(
        "qemu-system-arm", "-machine", "mps2-an500", "-cpu", "cortex-m7", "-nographic", "-icount", "shift=0",
        "-semihosting-config", "enable=on,target=native", "-kernel", "board.elf", folder=folder,
    )  # fmt: skip
    names = ("plain", "most", "mean", "fix", "odometer", "state")
    numbers = dict(zip(names, map(float, re.findall(r"\d+", counted)[:6]), strict=True))
    text = sum(int(line.split()[0]) for line in sizes.splitlines()[1:])
    return {**numbers, "flash": text, "stack": max(stack), "ipc": _instructions_a_cycle(gcc, folder)}


def _instructions_a_cycle(gcc: tuple[str, ...], folder: Path) -> float:
    """What llvm-mca expects of the propagation's arithmetic: of every basic block as often as it stands there."""
    assembly = _run(*gcc, "-S", "-o", "-", "covariance.c", folder=folder)
    # llvm-mca has no latencies of comparisons and of stores of many registers, and follows no label and no IT block
    wanted, unknown = r"\s+(v|ldr|str|add|sub|mov|mul|cmp)", r"vcmp|vmrs|vldm|vstm|vpush|vpop|\.L|:lower|:upper|sch_"
    unknown += r"|^\s+(?!vf?n?mls)\w+(hi|ls|ne|eq|gt|lt|ge|le|cs|cc|mi|pl)[.\s]"
    lines = [line for line in assembly.splitlines() if re.match(wanted, line) and not re.search(unknown, line)]
    (folder / "blocks.s").write_text(".syntax unified\n.thumb\n" + "\n".join(lines) + "\n")
    mca = shutil.which("llvm-mca") or shutil.which("llvm-mca-14") or "llvm-mca"
    report = _run(
        mca, "-march=thumb", "-mtriple=thumbv7em-none-eabihf", "-mcpu=cortex-m7", "-iterations=1", "blocks.s",
        folder=folder,
    )  # fmt: skip
    return float(re.search(r"IPC:\s+([\d.]+)", report).group(1))


def main() -> None:
    """Print the table of the documentation."""
    heads = (
        "states",
        "precision",
        "flash",
        "sch_state",
        "stack",
        "sample",
        "and propagation",
        "and fix",
        "mean",
        "cycles",
    )
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for name, entries in _ROWS:
        base = {"imu": _IMU, "gnss": {"lever_arm_m": [0.8, 0.0, -1.2]}}
        config, prepared = simulated_run(NavigationConfig.parse({**base, **entries}))
        for precision, flags in (("double", ()), ("single", ("-DSCH_FLOAT",))):
            with tempfile.TemporaryDirectory() as path:
                write_sources(path, filter_design(config, prepared))
                m = measured(Path(path), flags)
            cells = [
                name,
                precision,
                f"{m['flash'] / 1024:.1f} kB",
                f"{m['state'] / 1024:.1f} kB",
                f"{m['stack']:.0f} B",
            ]
            cells += [f"{m[key] / 1000:.1f}" for key in ("plain", "most", "fix", "mean")]
            print("| " + " | ".join([*cells, f"{m['mean'] / m['ipc'] / 1000:.1f}"]) + " |")


if __name__ == "__main__":
    main()
