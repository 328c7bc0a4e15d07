"""What real autopilots in their own simulators answer before a flight. Skipped without a program; a skip is no pass."""

import asyncio
import contextlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import SystemClock
from drivers.errors import SimulationError, VehicleError
from drivers.mavlink.autopilots import autopilot_of
from drivers.mavlink.codec import Codec
from drivers.mavlink.identity import read_identities
from drivers.mavlink.link import open_link
from drivers.mavlink.parameters import read_parameters
from drivers.mavlink.timesync import measure_clock
from drivers.mavlink.transport import LinkAddress
from drivers.mavlink.vehicle import Vehicle
from drivers.simulation.launcher import process_group
from drivers.simulation.sitl import SITLS, SitlVehicle
from planner.frames import GeodeticPosition

HOME = GeodeticPosition(-35.363262, 149.165237, 584.0)
KNOWN = {
    "ardupilot": {"SYSID_MYGCS": 255.0, "FS_GCS_ENABLE": 5.0, "GUID_TIMEOUT": 1.0, "RTL_ALT": 1500.0},
    "px4": {"COM_OBL_RC_ACT": 5.0, "NAV_DLL_ACT": 3.0, "COM_OF_LOSS_T": 1.0, "COM_RCL_EXCEPT": 4.0},
}
"""Parameters of either type, as they are set for a swarm."""

each_autopilot = pytest.mark.parametrize(
    "name",
    [
        pytest.param("ardupilot", marks=pytest.mark.sitl_ardupilot),
        pytest.param("px4", marks=pytest.mark.sitl_px4),
    ],
)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(200)]


@contextlib.asynccontextmanager
async def flying(name, folder, system_ids):
    """Start simulators of an autopilot and yield the vehicles."""
    sitl = SITLS[name]
    try:
        sitl.find()
    except SimulationError as error:
        pytest.skip(str(error))
    async with contextlib.AsyncExitStack() as stack:
        group = await stack.enter_async_context(process_group(folder))
        vehicles = []
        for system_id in system_ids:
            address = LinkAddress("udpin", "127.0.0.1", sitl.port(system_id))
            link = await stack.enter_async_context(open_link(address, Codec(), SystemClock()))
            vehicles.append(Vehicle(f"U{system_id}", system_id, link, SystemClock()))
            await sitl.start(SitlVehicle(f"U{system_id}", system_id, link.address.port, HOME), group)
        for vehicle in vehicles:
            await vehicle.wait_until(lambda vehicle=vehicle: vehicle.custom_mode is not None, 30.0, "heartbeat", "-")
        yield vehicles


@each_autopilot
async def test_two_of_a_kind_tell_who_they_are_what_time_it_is_and_their_parameters(name, tmp_path):
    async with flying(name, tmp_path, (1, 2)) as (first, second):
        await asyncio.sleep(2.0)  # no autopilot answers before it is up
        (one,), (other,) = await asyncio.gather(read_identities(first), read_identities(second))
        assert one.uid
        assert other.uid
        assert one.uid != other.uid
        assert int(one.firmware.split(".")[0]) >= 1
        offset = await measure_clock(first)
        assert 0.0 < offset.round_trip_s < 0.1
        expected = KNOWN[name]
        found = await read_parameters(first, [*expected, "NOT_THERE"], autopilot_of(first).parameters.value_of)
        assert found == expected


@each_autopilot
async def test_its_own_checks_are_run_on_request_and_arm_nothing(name, tmp_path):
    async with flying(name, tmp_path, (1,)) as (vehicle,):
        texts = []
        vehicle.on_text.append(texts.append)
        await vehicle.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS, what="checks")
        await asyncio.sleep(2.0)
        assert not vehicle.armed
        complaint = autopilot_of(vehicle).complaint
        assert name != "ardupilot" or any(text.startswith(complaint) for text in texts), texts


@pytest.mark.sitl_ardupilot
async def test_a_reboot_is_noticed_and_everything_is_asked_for_again(tmp_path):
    async with flying("ardupilot", tmp_path, (1,)) as (vehicle,):
        notices = []
        vehicle.on_notice.append(notices.append)
        vehicle.rates.ask({mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0, mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0})
        await vehicle.wait_until(lambda: not vehicle.rates.missing, 30.0, "telemetry", "-")
        await asyncio.sleep(6.0)
        await vehicle.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, what="reboot")
        await vehicle.wait_until(lambda: vehicle.reboots > 0, 10.0, "reboot noticed", "-")
        await vehicle.wait_until(lambda: not vehicle.rates.missing, 10.0, "telemetry after the reboot", "-")
        await asyncio.sleep(5.0)
        assert vehicle.reboots == 1
        assert notices[-1] == "U1 has rebooted"


@pytest.mark.sitl_px4
async def test_px4_s_simulator_refuses_to_reboot(tmp_path):
    async with flying("px4", tmp_path, (1,)) as (vehicle,):
        await asyncio.sleep(3.0)
        with pytest.raises(VehicleError, match="MAV_RESULT_DENIED"):
            await vehicle.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, what="reboot")
