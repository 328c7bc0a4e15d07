"""Ground stations from PyPI fly an embedded copter; somebody on another link watches what really happens."""

import asyncio
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

GUIDED, LAND = 4, 9
SPEEDUP = "5"
MODULES = "link,signing,log,misc,cmdlong,output,arm,mode,param"


@pytest.fixture
def flown(start_copter, make_observer, free_port):
    """A running copter: the port its ground station has to listen on, and an observer on another link."""
    station_port, observer = free_port(), make_observer()
    start_copter(
        [f"udpout:127.0.0.1:{station_port}", f"udpout:127.0.0.1:{observer.port}"],
        *("--speedup", SPEEDUP, "--param", "WPNAV_SPEED_DN=300"),
    )
    assert observer.wait(lambda _: True), "the copter does not speak"
    return station_port, observer


@pytest.fixture
def mavproxy(flown, tmp_path):
    """A headless MAVProxy; it takes commands on its standard input."""
    program = Path(sys.executable).with_name("mavproxy.py")
    if not program.exists():
        pytest.fail(f"{program} is missing: pip install --no-deps MAVProxy, and pyserial")
    command = [sys.executable, str(program), f"--master=udpin:127.0.0.1:{flown[0]}", f"--state-basedir={tmp_path}"]
    command += ["--aircraft=stock", f"--default-modules={MODULES}"]
    log = tmp_path / "mavproxy.txt"
    with log.open("w") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, text=True, cwd=tmp_path
        )
        process.log = log
        yield process
        process.kill()
        process.communicate()


def test_mavproxy_arms_takes_off_and_lands(flown, mavproxy):
    _, observer = flown

    def bring_about(command, holds, timeout_s):
        for _ in range(10):
            assert mavproxy.poll() is None, mavproxy.log.read_text()
            mavproxy.stdin.write(f"{command}\n")
            mavproxy.stdin.flush()
            if observer.wait(holds, timeout_s):
                return
        pytest.fail(f"{command!r} had no effect\n{mavproxy.log.read_text()}")

    bring_about("mode GUIDED", lambda o: o.mode == GUIDED, 2)
    bring_about("arm throttle", lambda o: o.armed, 2)
    bring_about("takeoff 10", lambda o: o.height_m > 9.5, 10)
    bring_about("mode LAND", lambda o: o.mode == LAND, 2)
    assert observer.wait(lambda o: not o.armed, 20)
    assert observer.height_m == 0.0
    assert {"Arming motors", "Disarming motors"} <= set(observer.texts)


async def test_mavsdk_arms_takes_off_and_lands(flown):
    try:
        from mavsdk.asyncio import ComponentType, Configuration, Mavsdk  # noqa: PLC0415
        from mavsdk.asyncio.plugins.action import ActionAsync  # noqa: PLC0415
        from mavsdk.asyncio.plugins.telemetry import TelemetryAsync  # noqa: PLC0415
    except ImportError as error:
        pytest.fail(f"MAVSDK is missing ({error}): pip install mavsdk")
    station_port, observer = flown

    async def watch(holds, timeout_s=20.0):
        return await asyncio.to_thread(observer.wait, holds, timeout_s)

    async with (
        asyncio.timeout(90),
        Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk,
    ):
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{station_port}")
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None, "MAVSDK found no autopilot"
        action, telemetry = ActionAsync(system), TelemetryAsync(system)
        async for health in telemetry.subscribe_health():
            if health.is_armable and health.is_home_position_ok:
                break
        await action.set_takeoff_altitude(10.0)
        await action.arm()
        assert await watch(lambda o: o.armed)
        await action.takeoff()
        assert await watch(lambda o: o.height_m > 9.5)
        assert (await telemetry.position()).relative_altitude_m == pytest.approx(10, abs=1)
        await action.land()
        assert await watch(lambda o: not o.armed)
    assert observer.height_m == 0.0
    assert {"Arming motors", "Disarming motors"} <= set(observer.texts)
