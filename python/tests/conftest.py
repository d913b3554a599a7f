"""Simulated runs of arms in `robots/`, made by the package's own simulator; measured logs where they are present."""

import os
import pathlib
import shutil
import tempfile

import pytest

import rivet

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def arm():
    """A direct-drive arm with two joints."""
    return ROOT / "robots/dd2/robot.toml"


@pytest.fixture(scope="session")
def ur10e():
    """A geared arm with six joints."""
    return ROOT / "robots/ur10e/robot.toml"


@pytest.fixture(scope="session")
def run(arm):
    """20 s of the two-joint arm, whose friction is 30 % and whose bodies are 10 % above the robot file's."""
    return rivet.simulate(arm, 20.0, seed=1, friction=1.3, bodies=1.1)


@pytest.fixture(scope="session")
def other(arm):
    """The same arm on another motion."""
    return rivet.simulate(arm, 20.0, seed=2, friction=1.3, bodies=1.1)


@pytest.fixture(scope="session")
def found(arm, run):
    """The parameters of that arm."""
    return rivet.identify(arm, run.log)


@pytest.fixture
def bus():
    """Prefix and root of a bus of this test alone. The root's path is short, as those of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="rv") as folder:
        prefix = f"py{os.getpid()}_"
        yield {"prefix": prefix, "root": folder}
    # The bus keeps one file a prefix.
    for left in pathlib.Path("/dev/shm").glob(f"{prefix}*"):
        left.unlink()


@pytest.fixture(scope="session")
def measured():
    """Measured logs of arms, from RIVET_DATA or the folder next to the checkout."""
    places = [os.environ.get("RIVET_DATA"), ROOT / "../shared/data/real"]
    for place in filter(None, places):
        if pathlib.Path(place).is_dir():
            return pathlib.Path(place)
    pytest.skip("no measured data: set RIVET_DATA to its folder")


@pytest.fixture(scope="session")
def programs():
    """The folder of the programs `rivet` and `rivetd`."""
    built = ROOT / "target/release"
    if (built / "rivet").is_file() and (built / "rivetd").is_file():
        return built
    installed = shutil.which("rivetd")
    if installed:
        return pathlib.Path(installed).parent
    pytest.skip("no programs: cargo build --release --workspace makes rivet and rivetd")
