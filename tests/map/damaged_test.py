#!/usr/bin/env python3
"""Damaged and foreign maps: every command of nilio map ends with status 0 or 1, never by a signal, and names the file.

  damaged_test.py FOLDER_OF_PROGRAMS [SEED]
"""
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile

programs = sys.argv[1]
seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.SystemRandom().randrange(1 << 32)
print(f"seed {seed}")
chance = random.Random(seed)
failed = 0


def expect(condition, text):
    global failed
    if not condition:
        failed += 1
        print(f"FAILED: {text}")


def nilio_map(*arguments):
    return subprocess.run([f"{programs}/nilio", "map", *map(str, arguments)], capture_output=True, text=True, timeout=60)


def expect_refused(done, *words):
    expect(done.returncode == 1 and all(word in done.stderr for word in words) and " - " in done.stderr,
           f"{done.args[2:]}: status {done.returncode}, {done.stderr!r} without {words}")


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    subprocess.run([f"{programs}/nilio", "simulate", "--length", "90", "--moving-start", folder / "drive"], check=True,
                   capture_output=True)
    subprocess.run([f"{programs}/niliod", "--replay", folder / "drive", "--output", folder / "run", "--set",
                    "publisher.enabled=false"], check=True, capture_output=True)
    whole = folder / "run/map"
    expect(nilio_map("info", whole).returncode == 0, "the whole map is read")
    expect(nilio_map("close", whole).returncode == 0, "the whole map is closed")
    poses = (whole / "poses").read_bytes()
    expect(nilio_map("close", whole).returncode == 0 and (whole / "poses").read_bytes() == poses,
           "a map that is closed again has the same poses")
    submaps = sorted(file.name for file in (whole / "submaps").iterdir())

    # Foreign folders.
    (folder / "empty").mkdir()
    (folder / "text").write_text("not a map")
    (folder / "foreign").mkdir()
    (folder / "foreign/map.log").write_bytes(b"a log of something else\n" * 50)
    for wrong in ("empty", "text", "foreign", "missing", "drive"):
        for command in (("info", folder / wrong), ("export", folder / wrong, folder / "a.ply"),
                        ("render", folder / wrong, folder / "a.png"), ("recover", folder / wrong),
                        ("close", folder / wrong),
                        ("merge", folder / wrong, "--output", folder / "merged"), ("diff", whole, folder / wrong),
                        ("crop", folder / wrong, folder / "part", "--min", 0, 0, 0, "--max", 1, 1, 1)):
            expect_refused(nilio_map(*command), wrong)
            shutil.rmtree(folder / "merged", ignore_errors=True)
    expect(not list(folder.glob("a.*")) and not (folder / "part").exists(), "a refused map left a file")

    # Outputs that cannot be.
    expect_refused(nilio_map("export", whole, folder / "map.xyz"), "map.xyz", ".las")
    expect_refused(nilio_map("export", whole, folder / "no/such/map.las"), "no/such/map.las")
    expect_refused(nilio_map("export", whole, folder / "path.geojson"), "path.geojson", "--origin")
    expect_refused(nilio_map("export", whole, folder / "path.kml"), "path.kml", "--gnss")
    expect("text:1: no column stamp_s" in nilio_map("close", whole, "--gnss", folder / "text").stderr, "text as positions")
    expect_refused(nilio_map("close", whole, "--gnss", folder / "none.csv"), "none.csv")
    # The simulated capture has sentences of a receiver.
    placed = folder / "placed"
    shutil.copytree(whole, placed)
    done = nilio_map("close", placed, "--gnss", folder / "drive/lidar.pcap")
    expect(done.returncode == 0 and "positions used" in done.stdout and "no altitude" in done.stdout, done.stdout + done.stderr)
    expect("origin         49.01" in nilio_map("info", placed).stdout, "info lacks the origin")
    for name in ("path.kml", "path.geojson"):
        expect(nilio_map("export", placed, folder / name).returncode == 0 and "8.41" in (folder / name).read_text(), name)
    expect_refused(nilio_map("render", whole, folder / "map.jpg"), "map.jpg")
    expect_refused(nilio_map("merge", whole, "--output", whole), "holds a map already")
    for arguments in (("export", whole, folder / "p.geojson", "--origin", "91,0,0,0"),
                      ("export", whole, folder / "p.ply", "--spacing", "0"), ("diff", whole),
                      ("close", whole, "--antenna", "0,0,1"), ("close", whole, "--gnss", "a", "--antenna", "0,1")):
        expect(nilio_map(*arguments).returncode == 2, f"{arguments} is accepted")

    # Each file cut or with a flipped byte, at drawn places.
    for trial in range(60):
        broken = folder / "broken"
        shutil.copytree(whole, broken)
        victim = broken / chance.choice(["map.log", "poses"] + [f"submaps/{file}" for file in submaps])
        content = bytearray(victim.read_bytes())
        place = chance.randrange(len(content))
        kind = chance.choice(("cut", "flipped", "missing"))
        if kind == "cut":
            victim.write_bytes(content[:place])
        elif kind == "flipped":
            content[place] ^= 1 << chance.randrange(8)
            victim.write_bytes(content)
        else:
            victim.unlink()
        what = f"{victim.relative_to(broken)} {kind} at {place} of {len(content)}"
        for command in (("info", broken), ("export", broken, folder / "b.las"), ("recover", broken)):
            done = nilio_map(*command)
            expect(done.returncode in (0, 1), f"{what}: {command[0]} ends with {done.returncode}")
            # A cut between two records cannot be told from a shorter map, nor can a map that was never closed.
            is_told = victim.name in done.stderr or (victim.name, kind) in (("map.log", "cut"), ("poses", "missing"))
            expect(is_told or command[0] == "recover", f"{what}: {command[0]} says {done.stderr!r}")
        shutil.rmtree(broken)
        (folder / "b.las").unlink(missing_ok=True)
        expect(not list(folder.glob("b.las*")), f"{what}: an unfinished file is left")
sys.exit(failed > 0)
