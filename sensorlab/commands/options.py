"""What the command line takes."""

import argparse
import math

from sensorlab.printable import printable


# written out, as the help shall not wait for the modules that define them
MODELS = ("white_noise", "random_walk", "markov", "random_walk_markov", "two_markov",
          "rate_ramp")
ALGORITHMS = "slopes", "gmwm", "aic", "bic", "whittle"
EFFECTS = (
    "rate_ramp", "bias_step", "pulse", "gradual_step", "ringing", "vibration_burst",
    "second_order_drift", "turn_on_transient", "sinusoid", "temperature",
    "thermal_lag", "scale_factor", "thermal_scale_factor", "misalignment",
    "nonlinearity", "latency", "lag", "g_sensitivity", "covariate", "hysteresis",
    "random_walk", "correlated_noise", "bias_instability", "narrow_band_noise",
    "bandwidth", "blue_noise", "noise_step", "noise_ramp", "noise_sensitivity",
    "walk_step", "outliers", "noise_bursts", "random_telegraph", "random_steps",
    "quantization", "integral_quantization", "differential_nonlinearity", "saturation",
    "stuck", "dropouts", "repeated_samples", "interpolated_samples", "moving_average",
    "steep_low_pass", "wrong_parameter")

RECORD = ("text with a header, .npz, .npy, .mat, .parquet, a ROS bag, .mcap, .ulg of "
          "PX4 or .bin of ArduPilot")

TARGETS = ("kalibr", "gazebo", "matlab", "px4", "gtsam", "openvins", "vins", "ros",
           "isaac", "numpy")

DESCRIPTION = """\
sensorid says which error model a gyro or an accelerometer follows, with which
parameters, and how well that can be known at all (Stepanov and Motorin,
Sensors 2019, 19(9), 1997); and why a simulated sensor differs from the real one."""


EPILOG = """\
a first session:
  python -m sensorid identify record.csv --plot record.png --unit deg/s \\
    --save-model gyro.json
  python -m sensorid criteria model.json --duration 2000 --trials 500
  python -m sensorid simulate model.json --samples 20000 --records 10 \\
    --out simulated.npz
  python -m sensorid diagnose record.csv --model model.json --out gap
  python -m sensorid export gyro.json --to kalibr --out imu.yaml

  python -m sensorid plan record.csv --target-rsd sigma_v=0.01

record.csv has a header: time,error. model.json holds the hypotheses:
  {"dt": 0.1, "unit": "deg/h", "bias_sigma": 1.0, "hypotheses": [
    {"name": "random_walk", "parameters": {"sigma_w": [0.04, 0.15], "sigma_v": 0.5}},
    {"name": "markov", "parameters": {
      "tau_m": [60, 1500], "sigma_m": [0.5, 1.5], "sigma_v": 0.5}}]}
A number is known, a range is to be found. tau_m is in s, every sigma in the unit of
the record, sigma_w per sample.
In place of model.json a data sheet, {"datasheet": {...}}, or the file of another
program is taken: Kalibr, Gazebo, MATLAB, AirSim, gnss-ins-sim, Isaac Lab;
imu.yaml#gyroscope names one of several sensors.
Hypotheses: """ + ", ".join(MODELS) + "."


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message):
        self.exit(2, f"{self.prog}: {printable(message)}; see {self.prog} --help\n")


class _Version(argparse.Action):
    """Prints the version, which is imported only then."""

    def __call__(self, parser, *rest):
        from sensorid import __version__
        print(f"sensorid {__version__}")
        parser.exit()


def parser():
    raw = argparse.RawDescriptionHelpFormatter
    root = _Parser(prog="sensorid", description=DESCRIPTION, epilog=EPILOG,
                     formatter_class=raw)
    root.add_argument("--version", action=_Version, nargs=0,
                      help="print the version and stop")
    commands = root.add_subparsers(dest="command", required=True, metavar="command",
                                     parser_class=_Parser)

    one = commands.add_parser(
        "identify", help="name the error model of a record", formatter_class=raw,
        description="Probability of every hypothesis and the parameters of each, "
                    "Eqs. (3)-(14).",
        epilog="Without --model, priors come from sample characteristics "
               "of the record.")
    one.add_argument("records", nargs="+", metavar="record", type=_file,
                     help=RECORD + "; several, or a folder, give one table")
    _hypotheses_options(one)
    one.add_argument("--compose", action="store_true",
                     help="describe the record as a sum: a hypothesis and whatever of "
                          "quantization, bandwidth, flicker, lines ... it needs")
    _record_options(one, several=True)
    _unit_options(one)
    _several_options(one)
    _json_option(one, "the result, with Phi, Gamma, H, Psi")
    one.add_argument("--csv", type=_file, metavar="OUT.csv",
                     help="write a table, a line for every record")
    one.add_argument("--save-model", type=_file, metavar="OUT.json",
                     help="write the most probable model, ready for simulate and "
                          "criteria; of several records OUT.NAME.json")
    one.add_argument("--plot", type=_file, metavar="OUT.png", help="draw the result")

    two = commands.add_parser(
        "criteria", help="how well the models of a file can be identified",
        formatter_class=raw,
        description="Error probability and relative standard deviations "
                    "against record length,\nEqs. (15)-(20), or how long must be "
                    "recorded for a target of them.",
        epilog="sensorid criteria M.json --duration 2000 --algorithms all\n"
               "sensorid criteria M.json --duration 2000 --target 0.02 "
               "--target-rsd tau_m=0.35\n"
               "sensorid criteria M.json --duration 2000 --target 0.05 "
               "--design dt=0.1,1 \\\n    --design sigma_v=0.1,0.5 --csv T.csv "
               "--plot T.png\n"
               "At another dt the random walk and the density of the white noise stay.")
    two.add_argument("model", type=_file, metavar="M.json",
                     help="hypotheses and priors")
    two.add_argument("--duration", type=_interval, required=True, metavar="S",
                     help="record length, s; with a target, the longest in question")
    two.add_argument("--trials", type=_count, metavar="L",
                     help="trials (default 500; 4000 with a target)")
    two.add_argument("--algorithms", type=_text, metavar="NAMES",
                     help="put others through the same trials: all, or any of "
                          + ", ".join(ALGORITHMS) + ", comma-separated")
    two.add_argument("--target", type=float, metavar="P",
                     help="how long must be recorded for this error probability")
    two.add_argument("--target-rsd", action="append", default=[], metavar="NAME=R",
                     help="the same for a relative standard deviation, such as "
                          "tau_m=0.2; may be repeated")
    two.add_argument("--design", action="append", default=[], metavar="NAME=V,V,...",
                     help="answer the targets for every sampling interval dt, s, or "
                          "white noise sigma_v, u; may be repeated for a grid of both")
    two.add_argument("--csv", type=_file, metavar="OUT.csv",
                     help="write the design table")
    two.add_argument("--seed", type=_seed, default=0,
                     help="of the random numbers, >= 0 (default 0)")
    two.add_argument("--checkpoint", type=_file, metavar="FOLDER",
                     help="keep finished chunks of trials there; "
                          "the same command takes up an interrupted run")
    _json_option(two)
    two.add_argument("--plot", type=_file, metavar="OUT.png", help="draw the result")

    four = commands.add_parser(
        "diagnose", help="why a record differs from a simulator", formatter_class=raw,
        description="Where a record differs from a simulator, which effect causes it,\n"
                    "how far the gap closes once that effect is added.",
        epilog="Effects looked for: " + ", ".join(EFFECTS) + ".\n"
               "--effects defines each of them; with a record, it gives their priors "
               "there.\n"
               "Without --model and --simulated, the simulator is white noise, random "
               "walk or\nMarkov process with priors from the record.")
    four.add_argument("records", nargs="*", metavar="record", type=_file,
                      help=RECORD + "; several, or a folder, give one table")
    four.add_argument("--effects", action="store_true",
                      help="define the effects that are looked for, and do no more")
    simulator = four.add_mutually_exclusive_group()
    simulator.add_argument("--model", type=_file, metavar="M.json",
                           help="the simulator")
    simulator.add_argument("--simulated", type=_file, metavar="FILE",
                           help="records of the simulator, error[L, N] or one column")
    _record_options(four, several=True)
    _unit_options(four)
    four.add_argument("--covariates", metavar="NAMES",
                      help="columns beside the error, comma-separated, NAME or "
                           "NAME=COLUMN, such as temperature=temp_degC "
                           "(default all but other axes, '' for none); of another "
                           "topic of the file, topic/field")
    _several_options(four)
    four.add_argument("--seed", type=_seed, default=0,
                      help="of the simulated records, >= 0 (default 0)")
    four.add_argument("--out", type=_file, metavar="DIR",
                      help="folder for report.html, .png and .json and model.json, "
                           "the simulator with the effects added; of several records "
                           "table.csv, too, and report.NAME.html and "
                           "model.NAME.json of each")

    six = commands.add_parser(
        "plan", help="how long the sensor of a record must be recorded",
        formatter_class=raw,
        description="How well the parameters of the sensor of a record will be known by"
                    " longer records,\nand which length a target takes.",
        epilog="sensorid plan ten_minutes.csv --target-rsd tau_m=0.2 --duration 86400\n"
               "Sensors are drawn from the posterior of the record under every "
               "hypothesis, and\nlonger records of each. Without --model, priors are "
               "those of the longer record.")
    six.add_argument("records", nargs=1, metavar="record", type=_file, help=RECORD)
    six.add_argument("--target-rsd", action="append", default=[], metavar="NAME=R",
                     help="which length gives this relative standard deviation, such "
                          "as tau_m=0.2; may be repeated")
    six.add_argument("--duration", type=_interval, metavar="S",
                     help="longest record in question, s (default 16 times this one)")
    _hypotheses_options(six)
    six.add_argument("--trials", type=_count, default=100, metavar="L",
                     help="sensors drawn for each hypothesis (default 100)")
    six.add_argument("--seed", type=_seed, default=0,
                     help="of the random numbers, >= 0 (default 0)")
    _record_options(six)
    six.set_defaults(report=None)
    six.add_argument("--unit", type=_text, metavar="U", help="unit of the record")
    six.add_argument("--scale", type=_numbers, default=(1.0,), metavar="X",
                     help="what the numbers of a record are multiplied by")
    _json_option(six)
    six.add_argument("--plot", type=_file, metavar="OUT.png", help="draw the result")

    three = commands.add_parser(
        "simulate", help="draw records from a model file", formatter_class=raw,
        description="Records from the prior of a model file; arrays error[L, N] "
                    "and dt, with the name of the true hypothesis and its "
                    "parameters.")
    three.add_argument("model", type=_file, metavar="M.json", help="the simulator")
    length = three.add_mutually_exclusive_group(required=True)
    length.add_argument("--samples", type=_count, metavar="N",
                        help="samples of a record")
    length.add_argument("--like", type=_file, metavar="RECORD",
                        help="as long as this record, and with its gaps")
    _record_options(three)
    three.add_argument("--covariates", metavar="NAMES",
                       help="where columns that the effects need are in this record, "
                            "NAME=COLUMN, comma-separated, such as "
                            "temperature=temp_degC")
    three.add_argument("--records", type=_count, default=1, metavar="L",
                       help="records (default 1)")
    three.add_argument("--seed", type=_seed, default=0,
                       help="of the random numbers, >= 0 (default 0)")
    three.add_argument("--out", type=_file, required=True, metavar="FILE.npz",
                       help="file to be written")

    five = commands.add_parser(
        "export", help="write a model for the program that uses it",
        formatter_class=raw,
        description="The sensor of a model file in the format of another program, "
                    "which says its\nconvention in a comment.",
        epilog="sensorid export gyro.json accel.json --to kalibr --horizon 60 "
               "--out imu.yaml\n"
               "Programs of two numbers, noise density and walk, get the smallest pair "
               "that bounds\nthe integrated error up to the horizon; the fitted pair "
               "stands beside it.")
    five.add_argument("models", nargs="+", metavar="M.json",
                      help="of a gyroscope, of an accelerometer or of both")
    five.add_argument("--to", required=True, choices=TARGETS, metavar="PROGRAM",
                      help=", ".join(TARGETS))
    five.add_argument("--horizon", type=float, metavar="S",
                      help="integration time up to which the two numbers bound, s "
                           "(default 60)")
    five.add_argument("--pair", choices=("bound", "fitted", "x10"),
                      help="which pair is written (default bound)")
    five.add_argument("--unit", type=_text, metavar="U",
                      help="of a model that does not say it, such as deg/s")
    five.add_argument("--dt", type=_interval, metavar="S",
                      help="sampling interval of a file that does not say it, s")
    five.add_argument("--duration", type=_interval, metavar="S",
                      help="of the records behind a bias_instability, s (default 3600)")
    five.add_argument("--out", type=_file, metavar="FILE",
                      help="file to be written (default: standard output)")
    return root


MOST = 10**8    # trials, samples or records: no machine serves more


def _count(text):
    """A number of things of the command line."""
    if not text.isdecimal() or len(text) > 18 or not 1 <= int(text) <= MOST:
        raise argparse.ArgumentTypeError(
            f"{text} is not a whole number from 1 to {MOST}")
    return int(text)


def _numbers(text):
    """Numbers of the command line, comma-separated."""
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not a number") from None


def _value(text):
    """A number of the command line."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not a number")
    return value


def _number(text):
    """What a text is as a number, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _time(text, least=0.0):
    """A time of the command line, s."""
    value = _number(text)
    if not least <= value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a number of seconds "
                                         f"{'>' if least else '>='} 0")
    return value


def _interval(text):
    """A length of time of the command line, s."""
    return _time(text, 5e-324)


def _seed(text):
    """A seed of the command line."""
    if not text.isdecimal() or len(text) > 18:
        raise argparse.ArgumentTypeError(
            f"{text} is not a whole number from 0 to 10^18")
    return int(text)


def _text(text, what="it"):
    """A text of the command line that is not empty."""
    if not text:
        raise argparse.ArgumentTypeError(
            f"{what} is empty: is a variable of the shell not set?")
    return text


def _file(text):
    """The name of a file."""
    return _text(text, "the name")


STDOUT = "-"    # in place of a file: standard output, where nothing else is then


def _json_option(parser, what="the result"):
    parser.add_argument("--json", type=_file, metavar="OUT.json",
                        help=f"write {what}; {STDOUT} prints it, and all else goes to "
                             "standard error")


def _hypotheses_options(parser):
    parser.add_argument("--model", type=_file, metavar="M.json",
                        help="hypotheses and priors")
    parser.add_argument("--hypotheses", type=_text, metavar="NAMES",
                        help="without --model: names, comma-separated, "
                             "or all (default white_noise,random_walk,markov)")


def _unit_options(parser):
    parser.add_argument("--unit", type=_text, metavar="U",
                        help="unit of the record, such as deg/s or mg (milli-g): "
                             "parameters are quoted as data sheets do; a model in "
                             "another unit has the record converted; of gyroscopes and "
                             "accelerometers deg/s,mg")
    parser.add_argument("--scale", type=_numbers, default=(1.0,), metavar="X",
                        help="what the numbers of a record are multiplied by, such as "
                             "the value of a count; two for two units")
    parser.add_argument("--report", type=_text, metavar="UNITS",
                        help="quote in these units, comma-separated, "
                             "such as 'deg/sqrt(h),deg/h'")


def _several_options(parser):
    parser.add_argument("--workers", type=_count, metavar="N",
                        help="processes that share several records (default: for "
                             "diagnose one a core, for identify one, as a record uses "
                             "all cores); the result does not depend on it")
    parser.add_argument("--checkpoint", type=_file, metavar="FOLDER",
                        help="keep the answers of finished records there; the same "
                             "command takes up an interrupted run")


def _record_options(parser, several=False):
    parser.add_argument("--column", "--channel", type=_file, default="error",
                        metavar="C",
                        help="column of the sensor error, such as gyro[0] or "
                             "imu/angular_velocity/x (default error)"
                             + "; several by comma, gyro for all of its axes, all for "
                               "those of the file" * several)
    parser.add_argument("--dt", type=_interval, metavar="S",
                        help="sampling interval, s "
                             "(default: from the clock of the record or the scalar dt)")
    parser.add_argument("--from", dest="start", type=_time, metavar="S",
                        help="leave out what is before, s from the first sample")
    parser.add_argument("--to", dest="end", type=_time, metavar="S",
                        help="leave out what comes after, s from the first sample")
    parser.add_argument("--average", type=_count, default=1, metavar="M",
                        help="take means of M samples, which shortens a long record; "
                             "a model must be for that interval")
    parser.add_argument("--resample", action="store_true",
                        help="take each sample of an uneven record at the nearest even "
                             "time; where there is none, it is missing")
    parser.add_argument("--missing", type=_value, action="append", default=[],
                        metavar="V",
                        help="take this value as a missing sample, such as -9999 (0 "
                             "of the record alone); may be given again")
    parser.add_argument("--allow-missing", action="store_true",
                        help="take NaN and empty cells as missing samples")
