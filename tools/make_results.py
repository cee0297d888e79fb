#!/usr/bin/env python3
"""Makes docs/results/scenes.md and the results table of README.md from the programs of a build.

  tools/make_results.py [--build build/release] [--work FOLDER] [--seeds 1,2,3] [--scenes town,...] [--without-real] [--check]

Simulates every scene with every seed, with a real sensor's errors (typical) and an ideal one, replays it with and without IMU, evaluates, and writes the tables. Real rows need recordings (NILIO_DATA); without them nothing is written, unless --without-real leaves these rows out.
With --check nothing is simulated: fails if README.md does not hold the table of docs/results/scenes.md.
"""
import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs/results/scenes.md"
README = ROOT / "README.md"
# scene, sensors, further options of nilio simulate
SCENES = [
    ("town", ["vlp16"], []),
    ("highway", ["vlp16"], []),
    ("tunnel", ["vlp16"], []),
    ("ramps", ["vlp16"], []),
    ("forest", ["vlp16"], []),
    ("manoeuvres", ["vlp16"], ["--duration", "90"]),
]
COLUMNS = "| data | drive | sensors | path m | t %, 10-80 m: median | worst | t %, 100-800 m: median | end drift %: median | worst | tracking / degraded / lost, all seeds |"
RULE = "|---|---|---|---:|---:|---:|---:|---:|---:|---:|"


def run(*command, allowed=(0,)):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode not in allowed:
        sys.exit(f"{' '.join(map(str, command))}: exit status {done.returncode}\n{done.stderr}{done.stdout}")


def replay(build, drive, truth, out, options=()):
    """Figures of one replay: niliod, then nilio evaluate."""
    # 3: tracking was lost, which the table shows.
    run(build / "bin/niliod", "--replay", drive, "--output", out, "--force", "--set", "publisher.enabled=false", *options, allowed=(0, 3))
    estimate = out / ("trajectory.kitti" if truth.suffix == ".txt" else "trajectory.tum")
    run(build / "bin/nilio", "evaluate", truth, estimate, "--json", out / "evaluation.json")
    figures = json.loads((out / "evaluation.json").read_text())
    counters = json.loads((out / "latency.json").read_text())["counters"]
    return {
        "path": figures["path"]["truth_m"],
        "short": figures["short_segments"]["translation_percent"],
        "long": figures["segments"]["translation_percent"] if figures["segments"] else None,
        "drift": figures["end_drift"]["percent"],
        "states": [counters["poses_" + state] for state in ("tracking", "degraded", "lost")],
    }


def row(data, drive, sensors, results):
    def median(key):
        values = [r[key] for r in results if r[key] is not None]
        return f"{statistics.median(values):.3f}" if values else "-"

    states = " / ".join(str(sum(r["states"][i] for r in results)) for i in range(3))
    worst = {key: f"{max(r[key] for r in results):.3f}" for key in ("short", "drift")}
    return (f"| {data} | {drive} | {sensors} | {statistics.median(r['path'] for r in results):.0f} | {median('short')} | {worst['short']} "
            f"| {median('long')} | {median('drift')} | {worst['drift']} | {states} |")


def simulated_rows(build, work, seeds, scenes, realism):
    names = {"vlp16": "VLP-16", "hdl64e": "HDL-64E"}
    for scene, sensors, options in SCENES:
        if scene not in scenes:
            continue
        for sensor in sensors:
            results = {"IMU": [], "": []}
            for seed in seeds:
                drive = work / f"{scene}_{sensor}_{seed}_{realism}"
                if not (drive / "truth.tum").exists():
                    run(build / "bin/nilio", "simulate", drive, "--scene", scene, "--sensor", sensor, "--seed", seed, "--realism", realism, *options)
                for imu, no_imu in (("IMU", []), ("", ["--set", "imu.enabled=false"])):
                    results[imu].append(replay(build, drive, drive / "truth.tum", work / f"run_{drive.name}_{imu}", no_imu))
                subprocess.run(["rm", "-rf", drive], check=True)
            for imu, list_of_results in results.items():
                yield row(f"simulated, {realism}", scene, names[sensor] + (", IMU" if imu else ""), list_of_results)
            print(f"{scene}, {sensor}, {realism}: done", file=sys.stderr)


def real_rows(build, work):
    data = Path(os.environ.get("NILIO_DATA", ROOT.parent / "shared/data")) / "kitti"
    archive = data / "odometry_04_frames_000-050.tar.xz"
    if not archive.exists():
        sys.exit(f"no data for the real rows: {archive} is not there - set NILIO_DATA, or leave these rows out with --without-real")
    with tarfile.open(archive) as tar:
        tar.extractall(work / "kitti")
    with tarfile.open(data / "odometry_poses_00-10.tar.xz") as tar:
        member = next(m for m in tar.getmembers() if m.name.endswith("04.txt"))
        poses = tar.extractfile(member).read().decode().splitlines()[:51]
    whole = next((work / "kitti").rglob("velodyne")).parent
    for drive, dropped in (("KITTI odometry 04, frames 0-50", []), ("the same with a gap of 1 s", list(range(20, 30)))):
        folder = work / f"kitti_{len(dropped)}"
        (folder / "velodyne").mkdir(parents=True, exist_ok=True)
        kept = [i for i in range(51) if i not in dropped]
        times = (whole / "times.txt").read_text().splitlines()
        for i in kept:
            link = folder / "velodyne" / f"{i:06d}.bin"
            link.unlink(missing_ok=True)
            link.symlink_to((whole / "velodyne" / link.name).resolve())
        (folder / "times.txt").write_text("".join(times[i] + "\n" for i in kept))
        (folder / "calib.txt").write_text((whole / "calib.txt").read_text())
        (folder / "truth.txt").write_text("".join(poses[i] + "\n" for i in kept))
        yield row("real", drive, "HDL-64E", [replay(build, folder, folder / "truth.txt", work / f"run_{folder.name}")])


def table_of(page):
    lines = page.splitlines()
    start = lines.index(COLUMNS)
    end = next((i for i in range(start, len(lines)) if not lines[i].startswith("|")), len(lines))
    return "\n".join(lines[start:end])


def replace_table(text, table):
    return re.sub(r"<!-- results -->.*?<!-- /results -->", lambda _: f"<!-- results -->\n{table}\n<!-- /results -->", text, flags=re.S)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=ROOT / "build/release")
    parser.add_argument("--work", type=Path, default=ROOT / "build/results")
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--scenes", default=",".join(scene for scene, _, _ in SCENES))
    parser.add_argument("--without-real", action="store_true")
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    if arguments.check:
        if replace_table(README.read_text(), table_of(PAGE.read_text())) != README.read_text():
            sys.exit("README.md: the results table differs from docs/results/scenes.md - run tools/make_results.py")
        return
    arguments.work.mkdir(parents=True, exist_ok=True)
    rows = [] if arguments.without_real else [*real_rows(arguments.build, arguments.work)]
    for realism in ("typical", "ideal"):
        rows += simulated_rows(arguments.build, arguments.work, arguments.seeds.split(","), arguments.scenes.split(","), realism)
    version = subprocess.run([arguments.build / "bin/niliod", "--version"], capture_output=True, text=True).stdout.strip()
    introduction = re.sub(r"(?s)\n\| data \|.*", "\n", PAGE.read_text()) if PAGE.exists() else "# Scenes\n"
    introduction = re.sub(r"(?m)^Made by .*$", f"Made by `tools/make_results.py --seeds {arguments.seeds} --scenes {arguments.scenes}{' --without-real' * arguments.without_real}` with nilio {version}.", introduction)
    PAGE.write_text(introduction.rstrip() + "\n\n" + "\n".join([COLUMNS, RULE, *rows]) + "\n")
    README.write_text(replace_table(README.read_text(), table_of(PAGE.read_text())))


if __name__ == "__main__":
    main()
