from .errors import ApplyReport as ApplyReport
from .errors import ImuErrors as ImuErrors
from .grades import GradeVerdict as GradeVerdict
from .grades import grade as grade
from .increments import integrate_rates as integrate_rates
from .initial_errors import InitialErrors as InitialErrors
from .noise import AutoRegressive as AutoRegressive
from .noise import Coloured as Coloured
from .noise import Counted as Counted
from .noise import Flicker as Flicker
from .noise import GaussMarkov as GaussMarkov
from .noise import GaussMarkov2 as GaussMarkov2
from .noise import NoiseModel as NoiseModel
from .noise import Process as Process
from .noise import Quantisation as Quantisation
from .noise import Ramp as Ramp
from .noise import RandomConstant as RandomConstant
from .noise import RandomWalk as RandomWalk
from .noise import SampledStateSpace as SampledStateSpace
from .noise import ShotNoise as ShotNoise
from .noise import Sinusoid as Sinusoid
from .noise import StateSpace as StateSpace
from .noise import White as White
from .noise import flicker as flicker
from .noise import gauss_markov as gauss_markov
from .noise import noise_model as noise_model
from .noise import quantise as quantise
from .noise import quantise_increments as quantise_increments
from .noise import random_walk as random_walk
from .noise import white as white
from .spec import ImuSpec as ImuSpec
from .spec import TriadSpec as TriadSpec
from .spec import allan_minimum as allan_minimum
from .spec_file import SpecFile as SpecFile
from .spec_file import read_spec as read_spec
from .spec_file import read_spec_file as read_spec_file
from .spec_file import spec_text as spec_text
from .spec_file import write_spec as write_spec
from .triads import AccelerometerTriad as AccelerometerTriad
from .triads import GyroTriad as GyroTriad
from .triads import SimpleTriad as SimpleTriad
from .triads import frd_from_fur as frd_from_fur
from .triads import fur_from_frd as fur_from_frd
from .triads import imu_errors as imu_errors
from .triads import triads_of as triads_of

__all__ = [
    "AccelerometerTriad",
    "ApplyReport",
    "AutoRegressive",
    "Coloured",
    "Counted",
    "Flicker",
    "GaussMarkov",
    "GaussMarkov2",
    "GradeVerdict",
    "GyroTriad",
    "ImuErrors",
    "ImuSpec",
    "InitialErrors",
    "NoiseModel",
    "Process",
    "Quantisation",
    "Ramp",
    "RandomConstant",
    "RandomWalk",
    "SampledStateSpace",
    "ShotNoise",
    "SimpleTriad",
    "Sinusoid",
    "SpecFile",
    "StateSpace",
    "TriadSpec",
    "White",
    "allan_minimum",
    "flicker",
    "frd_from_fur",
    "fur_from_frd",
    "gauss_markov",
    "grade",
    "imu_errors",
    "integrate_rates",
    "noise_model",
    "quantise",
    "quantise_increments",
    "random_walk",
    "read_spec",
    "read_spec_file",
    "spec_text",
    "triads_of",
    "white",
    "write_spec",
]
