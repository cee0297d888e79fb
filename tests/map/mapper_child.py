"""The nilio-mapper that a niliod has started, for tests that kill it."""
import os
import pathlib
import signal


def mapper_of(niliod):
    """The nilio-mapper that niliod has started last, or None."""
    try:
        children = pathlib.Path(f"/proc/{niliod}/task/{niliod}/children").read_text().split()
        return next((int(pid) for pid in reversed(children)
                     if pathlib.Path(f"/proc/{pid}/stat").read_text().split(") ")[0].endswith("(nilio-mapper")
                     and pathlib.Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"), None)
    except OSError:
        return None


def kill(mapper):
    """Whether it still ran."""
    try:
        os.kill(mapper, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def has_begun(run):
    """Whether the run has a map to read."""
    log = run / "map/map.log"
    return log.exists() and log.stat().st_size > 0
