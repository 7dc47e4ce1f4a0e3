from .aid_truth import AidTruth as AidTruth
from .gait import WalkMotion as WalkMotion
from .gait import walk as walk
from .gnss import GnssFault as GnssFault
from .gnss import GnssModel as GnssModel
from .gnss import SimulatedGnss as SimulatedGnss
from .gnss import draw_gnss as draw_gnss
from .gnss import simulate_gnss as simulate_gnss
from .imu import FaultyStream as FaultyStream
from .imu import IdealImu as IdealImu
from .imu import SimulatedImu as SimulatedImu
from .imu import StreamFaults as StreamFaults
from .imu import faulty_stream as faulty_stream
from .imu import ideal_imu as ideal_imu
from .imu import mounted as mounted
from .imu import simulate_imu as simulate_imu
from .imu import truth as truth
from .motion import LocalMotion as LocalMotion
from .motion import Motion as Motion
from .motion import MotionState as MotionState
from .motion import StaticMotion as StaticMotion
from .motion import coning_motion as coning_motion
from .motion import euler_attitude as euler_attitude
from .motion import ideal_increments as ideal_increments
from .motion import ideal_rates as ideal_rates
from .motion import inertial_quantities as inertial_quantities
from .profiles import Manoeuvre as Manoeuvre
from .profiles import ManoeuvreMotion as ManoeuvreMotion
from .profiles import SplineMotion as SplineMotion
from .profiles import polynomial_motion as polynomial_motion
from .routine import RoutineMotion as RoutineMotion
from .routine import free_routine as free_routine
from .routine import six_face_routine as six_face_routine
from .routine import thesis_routine as thesis_routine
from .satellites import BlockedSky as BlockedSky
from .satellites import RangeFault as RangeFault
from .satellites import SatelliteModel as SatelliteModel
from .satellites import SimulatedSatellites as SimulatedSatellites
from .satellites import SkyWindow as SkyWindow
from .satellites import simulate_satellites as simulate_satellites
from .scalar_aids import HeadingModel as HeadingModel
from .scalar_aids import HeightModel as HeightModel
from .scalar_aids import SimulatedScalar as SimulatedScalar
from .scalar_aids import simulate_heading as simulate_heading
from .scalar_aids import simulate_height as simulate_height
from .scalar_aids import simulate_odometer as simulate_odometer
from .scenario import Mission as Mission
from .scenario import Scenario as Scenario
from .scenario import Simulation as Simulation
from .scenario import prepare_mission as prepare_mission
from .scenario import simulate as simulate
from .scenario import simulate_mission as simulate_mission
from .steps import Rest as Rest
from .steps import Routine as Routine
from .steps import Turn as Turn
from .steps import pose_in_words as pose_in_words
from .waypoints import Waypoint as Waypoint
from .waypoints import WaypointMotion as WaypointMotion

__all__ = [
    "AidTruth",
    "BlockedSky",
    "FaultyStream",
    "GnssFault",
    "GnssModel",
    "HeadingModel",
    "HeightModel",
    "IdealImu",
    "LocalMotion",
    "Manoeuvre",
    "ManoeuvreMotion",
    "Mission",
    "Motion",
    "MotionState",
    "RangeFault",
    "Rest",
    "Routine",
    "RoutineMotion",
    "SatelliteModel",
    "Scenario",
    "SimulatedGnss",
    "SimulatedImu",
    "SimulatedSatellites",
    "SimulatedScalar",
    "Simulation",
    "SkyWindow",
    "SplineMotion",
    "StaticMotion",
    "StreamFaults",
    "Turn",
    "WalkMotion",
    "Waypoint",
    "WaypointMotion",
    "coning_motion",
    "draw_gnss",
    "euler_attitude",
    "faulty_stream",
    "free_routine",
    "ideal_imu",
    "ideal_increments",
    "ideal_rates",
    "inertial_quantities",
    "mounted",
    "polynomial_motion",
    "pose_in_words",
    "prepare_mission",
    "simulate",
    "simulate_gnss",
    "simulate_heading",
    "simulate_height",
    "simulate_imu",
    "simulate_mission",
    "simulate_odometer",
    "simulate_satellites",
    "six_face_routine",
    "thesis_routine",
    "truth",
    "walk",
]
