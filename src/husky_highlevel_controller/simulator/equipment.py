"""Equipment of the simulated robot: drive, encoders, battery and sensors, of Gazebo or of a real Husky.

In: a `SimulatorConfig`, the robot's model. Out: `Equipment`, with a list of sensors.
"""

from __future__ import annotations

from typing import Any, List, NamedTuple, Optional, Union

from husky_highlevel_controller.datatypes import HuskyError, Vector3
from husky_highlevel_controller.robot import DriveConfig
from husky_highlevel_controller.simulator.diff_drive import Drive
from husky_highlevel_controller.simulator.husky_base import HuskyBase
from husky_highlevel_controller.simulator.models.robot_model import RobotModel
from husky_highlevel_controller.simulator.power import Power
from husky_highlevel_controller.simulator.sensors.gps import Gps
from husky_highlevel_controller.simulator.sensors.imu import Imu, Magnetometer
from husky_highlevel_controller.simulator.sensors.lidar import CastRays, Lidar
from husky_highlevel_controller.simulator.sensors.lms1xx import Lms1xx
from husky_highlevel_controller.simulator.sensors.point_lidar import PointLidar
from husky_highlevel_controller.simulator.sensors.vibration import VibratingImu
from husky_highlevel_controller.simulator.simulator_config import ODOMETRY_RATE, SimulatorConfig, steps_per

# Each sensor has a random generator (stream) for its own noise, so that no sensor changes the noise of
# another sensor. The generators come from one seed and from these numbers, as the spawn key of NumPy's
# SeedSequence. The lidar has no number, because its generator comes from the seed alone. If it had one, a
# seed would give other noise of the lidar than in older versions.
LIDAR_STREAM = None
IMU_STREAM = 1  # number of the random generator for the IMU's noise, see LIDAR_STREAM
GPS_STREAM = 2  # number of the random generator for the noise of the GPS
MAG_STREAM = 3  # number of the random generator for the noise of the magnetometer
POINTS_STREAM = 4  # number of the random generator for the noise of the 3D lidar


class Sensor(NamedTuple):
    """A sensor, its sampling period, its field in `Snapshot`, and the number of its random generator."""

    steps: int  # number of physics steps between two samples
    device: Any  # sensor, an object with reset(rng) and sample(state, stamp)
    field: str  # name of the sensor's field in `Snapshot`
    stream: Optional[int]  # number of the random generator for the sensor's noise, such as IMU_STREAM


class Equipment(NamedTuple):
    """Drive train, sensors and battery of the robot."""

    drive: Drive
    imu: Union[Imu, VibratingImu]
    sensors: List[Sensor]
    points: Optional[PointLidar]  # 3D lidar, sampled only by `Simulation.points`; None if the robot has none
    power: Optional[Power] = None  # None for Gazebo's robot


def equip(
    config: SimulatorConfig, drive_config: DriveConfig, model: RobotModel, cast: CastRays, gravity: Vector3
) -> Equipment:
    """Return the equipment of a real Husky if `config.real` is set, otherwise of Gazebo's robot.

    Args:
        config: rates and sensors.
        drive_config: limits of the drive, with the wheels' distance and radius of the model.
        model: poses of the sensors' frames; without the lidar's frame the robot has no lidar.
        cast: measures the beams of the lidars.
        gravity: gravity in the world [m/s^2].

    Raises:
        HuskyError: a period is not a multiple of the physics step, or shorter than a sweep of the lidar.
    """
    rate, real = config.physics_rate, config.real
    dt = 1.0 / rate  # [s] duration of a physics step
    # numbers of physics steps from one sample of a sensor to the next
    scan_steps = steps_per(config.scan_rate, rate, "scan_rate")
    imu_steps = steps_per(config.imu_rate, rate, "imu_rate")
    imu = _imu(config, drive_config, imu_steps * dt, gravity)
    sensors = [Sensor(imu_steps, imu, "imu", IMU_STREAM)]
    points = None
    has_lidar = model.laser_frame in model.fixed_poses
    if has_lidar:
        lidar = _lidar(config, model, cast, scan_steps * dt)
        sensors.append(Sensor(scan_steps, lidar, "scan", LIDAR_STREAM))
        if config.points_rate:
            # the 3D lidar is not in `sensors`, because it is sampled only when `Simulation.points` is called;
            # `Simulation.step` samples all devices in `sensors`
            points = PointLidar(config.points, cast, model.fixed_poses[model.laser_frame])
    if config.gps_rate:
        gps_steps = steps_per(config.gps_rate, rate, "gps_rate")
        sensors.append(Sensor(gps_steps, Gps(config.gps, gps_steps * dt), "gps", GPS_STREAM))
    if not real:
        # Gazebo's robot has neither a magnetometer nor a battery
        return Equipment(Drive(drive_config), imu, sensors, points)
    _check_control_rate(real.base.control_rate, rate)
    sensors.append(Sensor(imu_steps, Magnetometer(), "mag", MAG_STREAM))
    power = Power(real.power, real.ground.rolling_current)
    return Equipment(HuskyBase(drive_config, real.base, dt), imu, sensors, points, power)


def _check_control_rate(control_rate: float, physics_rate: float) -> None:
    """Raise HuskyError if the encoders of a real Husky cannot be read at this rate [Hz].

    They are read only together with odometry, so their period must be a whole number of periods of odometry,
    and of physics steps.
    """
    for other_rate in (ODOMETRY_RATE, physics_rate):
        steps_per(control_rate, other_rate, "base/control_rate")  # raises the error; the result is not needed


def _imu(
    config: SimulatorConfig, drive_config: DriveConfig, period: float, gravity: Vector3
) -> Union[Imu, VibratingImu]:
    """Return the IMU, which vibrates with the ground if `config.real` is set.

    `period` is the time from sample to sample [s].
    """
    mount = config.robot.imu_mount
    imu = Imu(config.imu, period, gravity, (mount.x, mount.y, mount.z))
    if config.real is None:
        return imu
    # [m] larger than the distance between the wheels, because wheels skid in a turn
    effective_track = drive_config.wheel_separation * drive_config.wheel_separation_multiplier
    return VibratingImu(imu, config.real.ground.vibration, effective_track)


def _lidar(
    config: SimulatorConfig, model: RobotModel, cast: CastRays, scan_time: float
) -> Union[Lidar, Lms1xx]:
    """Return the planar lidar of Gazebo's robot, or of the real Husky if `config.real` is set.

    Raises HuskyError if the real lidar's sweep takes longer than `scan_time` [s], the time from scan to scan.
    """
    frame = model.laser_frame
    pose = model.fixed_poses[frame]
    if config.real is None:
        return Lidar(config.lidar, cast, frame, pose)
    lidar_config = config.real.lidar
    if lidar_config.sweep_time > scan_time:
        raise HuskyError(
            f"scan_rate = {config.scan_rate} Hz is too fast, because a sweep of robot_profile/lidar "
            f"takes {1000.0 * lidar_config.sweep_time:.1f} ms; choose a lower scan_rate"
        )
    return Lms1xx(lidar_config, cast, frame, pose, scan_time)
