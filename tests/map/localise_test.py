#!/usr/bin/env python3
"""Localisation in a saved map by niliod --replay --map: the outputs, the same bits again, and maps that cannot be used.

  localise_test.py FOLDER_OF_PROGRAMS
"""
import hashlib
import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile

programs = sys.argv[1]
failed = 0


def expect(condition, text):
    global failed
    if not condition:
        failed += 1
        print(f"FAILED: {text}")


def niliod(*arguments):
    return subprocess.run([f"{programs}/niliod", *map(str, arguments), "--set", "publisher.enabled=false", "--set",
                           "output.run_mcap=false"], capture_output=True, text=True, timeout=300)


def simulate(folder, visit):
    subprocess.run([f"{programs}/nilio", "simulate", "--length", "110", "--moving-start", "--visit", str(visit), folder], check=True,
                   capture_output=True)


def content(folder):
    return {file.relative_to(folder): hashlib.sha256(file.read_bytes()).hexdigest()
            for file in sorted(folder.rglob("*")) if file.is_file()}


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    simulate(folder / "first", 1)
    simulate(folder / "second", 2)
    expect(niliod("--replay", folder / "first", "--output", folder / "mapped").returncode == 0, "the map is made")
    saved = folder / "mapped/map"
    before = content(saved)

    done = niliod("--replay", folder / "second", "--map", saved, "--output", folder / "run")
    expect(done.returncode == 0, f"the run ends with status {done.returncode}: {done.stderr}")
    expect(content(saved) == before, "the saved map is not changed")
    expect((folder / "run/map/map.log").exists(), "the run writes its own map")
    expect(f"localisation: {saved}: map " in done.stderr and "localised near submap" in done.stderr, f"the log tells of it: {done.stderr}")
    expect(json.load(open(folder / "run/latency.json"))["localisation"] == "localised", "latency.json has the state")
    lines = (folder / "run/trajectory_map.tum").read_text().splitlines()
    expect(len(lines) > 50, f"{len(lines)} poses in the frame of the map")
    # Both drives take the same way.
    road = [tuple(map(float, line.split()[1:3])) for line in open(folder / "mapped/trajectory.tum")]
    worst = max(min(math.dist(tuple(map(float, line.split()[1:3])), place) for place in road) for line in lines)
    expect(worst < 1.5, f"a pose in the map is {worst:.2f} m from the road")

    expect(niliod("--replay", folder / "second", "--map", saved, "--output", folder / "again").returncode == 0, "the run is repeated")
    for file in ("localisation.txt", "trajectory_map.tum"):
        expect((folder / "run" / file).read_bytes() == (folder / "again" / file).read_bytes(), f"{file} has the same bytes again")
    odometry = (folder / "run/trajectory.tum").read_bytes()
    done = niliod("--replay", folder / "second", "--map", saved, "--output", folder / "without", "--set", "output.map=false")
    expect(done.returncode == 0 and not (folder / "without/map").exists(), "localises without writing a map")
    expect((folder / "without/localisation.txt").read_bytes() == (folder / "run/localisation.txt").read_bytes(),
           "which changes nothing")

    # The folder that the run writes.
    done = niliod("--replay", folder / "second", "--map", folder / "run/map", "--output", folder / "run", "--force")
    expect(done.returncode == 2 and "choose another --output" in done.stderr, f"same folder: {done.returncode} {done.stderr}")
    expect((folder / "run/map/map.log").exists(), "and it is still there")

    # Maps that cannot be used.
    (folder / "empty").mkdir()
    shutil.copytree(saved, folder / "damaged")
    (folder / "damaged/map.log").write_bytes(b"something else\n" * 20)
    shutil.copytree(saved, folder / "unreadable")
    for file in (folder / "unreadable/submaps").iterdir():
        file.write_bytes(file.read_bytes()[:200])
    shutil.copytree(saved, folder / "no_submaps")
    header = (saved / "map.log").read_bytes()
    (folder / "no_submaps/map.log").write_bytes(header[:20 + int.from_bytes(header[:4], "little")])
    for wrong in ("missing", "empty", "damaged", "unreadable", "no_submaps"):
        done = niliod("--replay", folder / "second", "--map", folder / wrong, "--output", folder / ("run_" + wrong))
        told = [line for line in done.stderr.splitlines() if "error: localisation: " in line]
        expect(done.returncode == 0 and len(told) == 1 and str(folder / wrong) in told[0] and " - " in told[0]
               and "poses go on" in told[0], f"{wrong}: {done.returncode} {done.stderr}")
        expect((folder / ("run_" + wrong) / "trajectory.tum").read_bytes() == odometry, f"{wrong}: the poses are the same")

print("failed" if failed else "passed")
sys.exit(1 if failed else 0)
