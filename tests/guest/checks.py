"""What only a machine with a display, a CAN bus and knobs can show, checked in the virtual machine of machine.py.

Every check prints PASS or FAIL with its reason, and what is not run is said. The exit status is 0 only where all passed.
"""

import argparse
import csv
import json
import math
import os
import re
import shutil
import signal
import sys
import time
import traceback

sys.dont_write_bytecode = True

import machine
import picture
import vkms

ROOT = os.path.dirname(os.path.dirname(machine.HERE))

WIDTH_PX, HEIGHT_PX = 800, 480

# The moment of the demonstration flight that is drawn on both screens.
STILL_S = 12

# One renderer draws both pictures, so they should be the same; what is allowed is rounding in a few edge pixels.
LEVELS_APART = 2
PART_BEYOND = 0.001

# A picture with terrain and instruments has thousands of colours; a blank screen or a console has a handful.
COLOURS_MIN = 100

# Emulated, a start takes seconds and a frame a good part of one.
PATIENCE_S = 700

CHECKS = []


def check(function):
    """Adds a check; they run in the order in which they stand here, on one guest."""
    CHECKS.append(function)
    return function


class Failed(Exception):
    """A check did not find what it should; the text says what it found."""


def demand(condition, found):
    """Fails the check with what was found, unless the condition holds."""
    if not condition:
        raise Failed(found)


class Bench:
    """The guest, the program in it, and where pictures are kept."""

    def __init__(self, options, guest):
        self.program, self.out, self.guest = os.path.abspath(options.program), options.out, guest
        # Making the terrain is a minute's work for an emulated processor, so it was made before.
        self.demo = f"{self.program} demo --antialiasing none --pack {os.path.abspath(options.pack)}"
        # The picture without a display, and the program that holds the display: checks leave them to later ones.
        self.reference = self.holder = None
        with open(options.tests) as file:
            self.tests = test_programs(file)

    def run(self, script, seconds=PATIENCE_S):
        """Runs a script to its end; the finished job, and a failure where it did not end."""
        job = self.guest.start(script)
        demand(job.wait(seconds) is not None, f"no end after {seconds} s: {script}\n{tail(job.output())}")
        return job

    def succeed(self, script, seconds=PATIENCE_S):
        """Runs a script that has to end with 0; what it printed."""
        job = self.run(script, seconds)
        demand(job.code() == 0, f"ended with {job.code()}: {script}\n{tail(job.output())}")
        return job.output()

    def run_tests(self, name, *arguments, skips_allowed=False):
        """Runs one of the test programs in the guest; the number of tests that passed, of which there must be some."""
        demand(name in self.tests, f"there is no test program '{name}' (there are: {', '.join(sorted(self.tests))})")
        words = " ".join([self.tests[name], "--test-threads=1", "--show-output", *arguments])
        output = self.succeed(f"cd {ROOT} && {words}")
        passed = sum(map(int, re.findall(r"^test result: ok\. (\d+) passed", output, re.MULTILINE)))
        demand(passed > 0, f"no test of {name} ran:\n{tail(output)}")
        demand(skips_allowed or "SKIPPED:" not in output, f"{name} skipped something here:\n{tail(output)}")
        return passed

    def keep(self, name):
        """Copies a file of the exchange folder to where the pictures are kept; its new path."""
        source = os.path.join(self.guest.exchange, name)
        demand(os.path.exists(source), f"the program did not write {name}")
        return shutil.copy(source, os.path.join(self.out, name.replace("/", "-")))

    def await_picture(self, wanted, job, name):
        """Looks at the display until it shows the picture; how far apart they are then."""
        path, until, apart = os.path.join(self.out, name), time.monotonic() + PATIENCE_S, None
        while time.monotonic() < until:
            demand(job.code() is None, f"the program ended with {job.code()}:\n{tail(job.output())}")
            self.guest.screenshot(path)
            shown = picture.read(path)
            size = f"{shown.width_px}x{shown.height_px}"
            if (shown.width_px, shown.height_px) == (wanted.width_px, wanted.height_px):
                apart = picture.Difference(wanted, shown, LEVELS_APART)
                if apart.beyond <= PART_BEYOND:
                    return apart
            time.sleep(1)
        found = f"{100 * apart.beyond:.3f} % of the pixels differ" if apart else f"the display has {size} pixels"
        raise Failed(f"{found} after {PATIENCE_S} s; see {path}\n{tail(job.output())}")


    def await_another(self, known, job, name):
        """Looks at the display until it shows another picture than the known one, and not an empty one."""
        path, until = os.path.join(self.out, name), time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            demand(job.code() is None, f"the program ended with {job.code()}:\n{tail(job.output())}")
            self.guest.screenshot(path)
            shown = picture.read(path)
            apart = picture.Difference(known, shown, LEVELS_APART)
            if shown.colours() >= COLOURS_MIN and apart.beyond > 0.05:
                return apart
            time.sleep(1)
        raise Failed(f"the display still shows what was there before, after {PATIENCE_S} s; see {path}\n{tail(job.output())}")


def tail(text, lines=25):
    """The end of what a program printed, indented."""
    return "\n".join("    | " + line for line in text.splitlines()[-lines:])


def test_programs(messages):
    """Name and path of each test program in Cargo's messages; the library's own is called 'lib'."""
    found = {}
    for line in messages:
        message = json.loads(line) if line.startswith("{") else {}
        if message.get("executable") and message["profile"]["test"]:
            target = message["target"]
            found["lib" if "lib" in target["kind"] else target["name"]] = message["executable"]
    return found


@check
def a_still_picture_without_a_display(bench):
    """The reference for the display: the same program, library and processor, before there is a card."""
    bench.succeed(f"{bench.demo} --still {STILL_S} --size {WIDTH_PX}x{HEIGHT_PX} --out /exchange/headless")
    bench.reference = picture.read(bench.keep("headless/still.png"))
    colours = bench.reference.colours()
    demand((bench.reference.width_px, bench.reference.height_px) == (WIDTH_PX, HEIGHT_PX), "it has another size")
    demand(colours >= COLOURS_MIN, f"it has only {colours} colours")
    return f"{colours} colours"


@check
def the_tests_of_the_screen_pass_on_a_display_with_vertical_blank(bench):
    """vkms: flips wait for a vertical blank at 60 Hz, and it is counted."""
    bench.succeed("modprobe vkms && until [ -e /dev/dri/card0 ]; do sleep 0.2; done")
    passed = bench.run_tests("screen_kms")
    # The console holds the card until it is sent away.
    bench.succeed("for c in /sys/class/vtconsole/vtcon[1-9]; do echo 0 >$c/bind; done; rmmod vkms")
    return f"{passed} tests"


@check
def a_card_appears(bench):
    """virtio-gpu: atomic modesetting and a scanout, no vertical blank."""
    bench.succeed("modprobe -a virtio_gpu virtio_input evdev && until [ -e /dev/dri/card0 ]; do sleep 0.2; done")
    if bench.reference is None:
        return "not compared with the picture: there is none"
    # What is compared below has to be able to differ.
    bench.guest.screenshot(os.path.join(bench.out, "console.png"))
    console = picture.read(os.path.join(bench.out, "console.png"))
    apart = picture.Difference(bench.reference, console, LEVELS_APART)
    demand(apart.beyond > 0.5, f"the console looks like the picture: {100 * apart.beyond:.1f} % of the pixels differ")
    return bench.succeed("cat /sys/class/drm/card0-*/status").strip()


@check
def the_tests_of_the_screen_pass_on_a_display_without_vertical_blank(bench):
    """The same on virtio-gpu, where a flip is over at once."""
    return f"{bench.run_tests('screen_kms')} tests"


@check
def the_display_shows_the_same_picture(bench):
    """What the host reads from the scanout is what was drawn without a display."""
    demand(bench.reference is not None, "there is no picture to compare with")
    bench.holder = bench.guest.start(f"{bench.demo} --screen kms --still {STILL_S} --seconds 3000 --out /tmp/still")
    apart = bench.await_picture(bench.reference, bench.holder, "display.png")
    return f"at most {apart.levels_max} of 255 apart, {100 * apart.beyond:.3f} % of the pixels beyond {LEVELS_APART}"


@check
def a_second_program_is_told_who_holds_the_display(bench):
    """Exit code 4 and one line that names the card and what to do."""
    demand(bench.holder is not None, "no first program was started")
    demand(bench.holder.code() is None, f"the first has ended:\n{tail(bench.holder.output())}")
    write_board(bench, "second", '[screen]\nkind = "kms"\n')
    job = bench.run(f"{bench.program} run --board /exchange/second.toml --seconds 5")
    said = [line for line in job.output().splitlines() if line.startswith("glasswing: ")]
    demand(job.code() == 4, f"it ended with {job.code()}:\n{tail(job.output())}")
    demand(len(said) == 1 and "/dev/dri/card0" in said[0] and said[0].endswith(")"), f"it said:\n{tail(job.output())}")
    return said[0]


@check
def a_killed_program_leaves_the_display_usable(bench):
    """The next one gets the card and shows its picture."""
    demand(bench.holder is not None, "no first program was started")
    bench.holder.kill()
    # Another moment of the flight: what the killed one left on the display is still there at first.
    holder = bench.guest.start(f"{bench.demo} --screen kms --still {STILL_S + 9} --seconds 3000 --out /tmp/still")
    apart = bench.await_another(bench.reference, holder, "display-again.png")
    holder.kill()
    return f"{100 * apart.beyond:.0f} % of the pixels are another picture's"


@check
def the_demonstration_flies_on_the_display(bench):
    """Two looks at it see two different pictures, and it ends by itself with its figures."""
    job = bench.guest.start(f"{bench.demo} --screen kms --seconds 30 --out /exchange/flight")
    pictures, path, until = [], os.path.join(bench.out, "flight.png"), time.monotonic() + PATIENCE_S
    while job.code() is None and time.monotonic() < until:
        bench.guest.screenshot(path)
        shown = picture.read(path)
        if shown.colours() >= COLOURS_MIN and shown.rows not in pictures:
            pictures.append(shown.rows)
            shutil.copy(path, os.path.join(bench.out, f"flight-{len(pictures)}.png"))
        time.sleep(2)
    demand(job.wait(PATIENCE_S) == 0, f"it ended with {job.code()}:\n{tail(job.output())}")
    demand(len(pictures) >= 2, f"the display showed {len(pictures)} different pictures:\n{tail(job.output())}")
    with open(bench.keep("flight/summary.json")) as file:
        summary = json.load(file)
    demand(summary["frames"] >= 3, f"only {summary['frames']} frames")
    return f"{summary['frames']} frames, {len(pictures)} different pictures seen"


@check
def a_can_bus_appears(bench):
    """vcan0, as on any Linux with the module."""
    bench.succeed("modprobe -a vcan can_raw && ip link add vcan0 type vcan && ip link set vcan0 up")
    return ""


@check
def two_can_controllers_appear(bench):
    """Emulated boards on one bus, switched on as the manual says."""
    on = "up type can bitrate 500000 restart-ms 100"
    bench.succeed(f"modprobe kvaser_pci && ip link set can0 {on} && ip link set can1 {on}")
    state = bench.succeed("ip -details link show can0")
    demand("ERROR-ACTIVE" in state and "bitrate 500000" in state, state)
    return ""


@check
def the_tests_of_the_buses_pass_on_a_can_bus(bench):
    """Those that say SKIPPED where there is no vcan0, no CAN controller or no virtual knob have to run here."""
    bench.succeed("modprobe -a uinput evdev")
    names = sorted(name for name in bench.tests if name.startswith("bus_"))
    demand(names, "there is no test program whose name begins with bus_")
    passed = {name: bench.run_tests(name) for name in names}
    passed["lib bus::"] = bench.run_tests("lib", "bus::")
    return ", ".join(f"{name}: {number}" for name, number in passed.items())


@check
def the_demonstration_flies_over_the_can_bus(bench):
    """The frames it draws from really went through the kernel's bus."""
    count = "cat /sys/class/net/vcan0/statistics/rx_packets"
    before = int(bench.succeed(count))
    output = bench.succeed(f"{bench.demo} --screen surfaceless --seconds 10 --out /exchange/can")
    sent = int(bench.succeed(count)) - before
    demand(sent >= 100, f"only {sent} frames passed vcan0:\n{tail(output)}")
    return f"{sent} frames passed vcan0"


@check
def a_simulated_flight_is_shown_as_it_is_flown(bench):
    """From the bench's frames through the kernel's bus to the numbers of the pictures, for both protocols on CAN."""
    shown = []
    for protocol in ("can-fix", "canaerospace"):
        board = HEADLESS + source("bench", protocol, 'can = "vcan0"')
        write_board(bench, protocol, board)
        flight = bench.guest.start(f"{bench.program} simulate --profile demo --as {protocol} --to can:vcan0 --seconds 60")
        folder = f"/exchange/{protocol}-frames"
        bench.succeed(f"{bench.program} run --board /exchange/{protocol}.toml --seconds 45 --frames-dir {folder}")
        flight.kill()
        with open(bench.keep(f"{protocol}-frames/frames.csv")) as file:
            rows = list(csv.DictReader(file))
        # The first minute of the profile: straight and level at 5000 feet and 95 knots, by an altimeter set to 1018 hPa.
        airspeeds = [float(row["indicated_airspeed_mps"]) / 0.514444 for row in rows if row["indicated_airspeed_mps"][0] != "!"]
        altitudes = [float(row["baro_altitude_m"]) / 0.3048 for row in rows if row["baro_altitude_m"][0] != "!"]
        pitches = [math.degrees(float(row["pitch_rad"])) for row in rows if row["pitch_rad"][0] != "!"]
        found = f"{protocol}: {len(rows)} pictures, {len(airspeeds)} airspeeds, {len(altitudes)} altitudes, {len(pitches)} pitches"
        # An emulated machine takes seconds for a picture.
        demand(min(len(airspeeds), len(altitudes), len(pitches)) >= 1, found)
        demand(all(abs(x - 95) < 4 for x in airspeeds), f"{found}: {airspeeds}")
        demand(all(abs(x - 5000) < 60 for x in altitudes), f"{found}: {altitudes}")
        demand(all(abs(x) < 8 for x in pitches), f"{found}: {pitches}")
        shown.append(found)
    return "; ".join(shown)


@check
def a_can_interface_that_is_not_there_is_named_and_waited_for(bench):
    """check refuses it; run says it once, flies, and opens it when it is there (what is heard then: tests/bus_can.rs)."""
    adahrs = source("adahrs", "canaerospace", 'can = "can9"')
    said = refusals(bench, "missing", adahrs)
    demand("source[0].can: can can9: there is no such interface (" in said, said)
    job = bench.guest.start(f"{bench.program} run --board /exchange/missing.toml --seconds 30 --stats /exchange/missing.json")
    bench.succeed("sleep 8 && ip link add can9 type vcan && ip link set can9 up")
    job.wait(PATIENCE_S)
    bench.succeed("ip link delete can9")
    warned = [line for line in job.output().splitlines() if "can can9: there is no such interface" in line]
    demand(job.code() == 0 and len(warned) == 1, f"it ended with {job.code()}:\n{tail(job.output())}")
    with open(bench.keep("missing.json")) as file:
        row = json.load(file)["sources"][0]
    demand(row["state"] == "open", f"it is not open: {json.dumps(row)}")
    return warned[0]


@check
def a_can_interface_that_is_off_is_named_and_how_it_is_switched_on(bench):
    """By check; run waits for it instead."""
    bench.succeed("ip link set can1 down")
    said = refusals(bench, "off", source("adahrs", "canaerospace", 'can = "can1"'))
    demand("source[0].can: can can1: the interface is switched off (ip link set can1 up" in said, said)
    return said


@check
def a_speed_that_a_port_does_not_have_is_refused(bench):
    """The port on the board ends at 115200 baud; the kernel would take another speed without a word."""
    said = refusals(bench, "speed", source("efis", "dynon-skyview", 'serial = "/dev/ttyS1"\nbaud = 3000000'))
    demand("source[0].baud: serial /dev/ttyS1: it does not do 3000000 baud, it would do" in said, said)
    return said


@check
def a_serial_adapter_that_is_pulled_out_is_heard_again_when_it_is_back(bench):
    """A USB serial adapter under a name that stays, as udev makes it; its node vanishes and comes back."""
    # ForeFlight attitude: roll 10 degrees, pitch 5.
    attitude = bytes.fromhex("7E 65 01 00 64 00 32 84 D2 00 5F 00 65 B7 EF 7E")
    bench.succeed("modprobe -a xhci_pci usbserial ftdi_sio")
    far_end = bench.guest.plug_in()
    bench.succeed("until [ -e /dev/ttyUSB0 ]; do sleep 0.2; done; mkdir -p /dev/serial/by-id && "
                  "ln -s ../../ttyUSB0 /dev/serial/by-id/usb-port0")
    write_board(bench, "usb", HEADLESS + source("tablet", "gdl90", 'serial = "/dev/serial/by-id/usb-port0"\nbaud = 115200'))
    command = f"{bench.program} run --board /exchange/usb.toml --seconds 40 --stats /exchange/usb.json"
    job = bench.guest.start(command)
    speak(bench, job, far_end, attitude, 15)
    far_end.close()
    bench.succeed("until [ ! -e /dev/ttyUSB0 ]; do sleep 0.2; done")
    far_end = bench.guest.plug_in()
    bench.succeed("until [ -e /dev/ttyUSB0 ]; do sleep 0.2; done")
    speak(bench, job, far_end, attitude, None)
    far_end.close()
    with open(bench.keep("usb.json")) as file:
        row = json.load(file)["sources"][0]
    found = json.dumps(row)
    demand(row["reopened"] >= 1 and row["device_events"].get("lost", 0) >= 1, f"it was not lost and found: {found}")
    demand(row["state"] == "open" and row["good"] > 100, f"it is not heard: {found}")
    demand(row["bad"] <= 4, f"more is bad than what was cut by pulling it out: {found}")
    return found


HEADLESS = '[screen]\nkind = "surfaceless"\n'


def source(name, protocol, endpoint):
    """A source of a board file."""
    return f'[[source]]\nname = "{name}"\nprotocol = "{protocol}"\n{endpoint}\n'


def refusals(bench, name, text):
    """What check says of a board file with a source that refuses: the first line."""
    write_board(bench, name, HEADLESS + text)
    job = bench.run(f"{bench.program} check --board /exchange/{name}.toml")
    said = [line for line in job.output().splitlines() if line.startswith("glasswing: ")]
    demand(job.code() == 4 and len(said) == 1, f"it ended with {job.code()}:\n{tail(job.output())}")
    return said[0]


def speak(bench, job, line, message, seconds):
    """Sends a message ten times a second, for so many seconds or until the job has ended well."""
    until = time.monotonic() + (seconds or PATIENCE_S)
    while time.monotonic() < until and job.code() is None:
        line.sendall(message)
        time.sleep(0.1)
    if seconds is None:
        demand(job.code() == 0, f"it ended with {job.code()}:\n{tail(job.output())}")
    else:
        demand(job.code() is None, f"it ended with {job.code()}:\n{tail(job.output())}")


def write_board(bench, name, text):
    """A board file in the exchange folder."""
    with open(os.path.join(bench.guest.exchange, f"{name}.toml"), "w") as file:
        file.write('inherit = "base"\n' + text)


def run_checks(bench, chosen):
    """Runs the checks one after the other; the names of those that failed."""
    failed = []
    for function in chosen:
        name, started = function.__name__.replace("_", " "), time.monotonic()
        try:
            outcome, found = "PASS", function(bench)
        except Failed as error:
            outcome, found = "FAIL", str(error)
        except machine.GuestError:
            raise
        except Exception:  # a check that breaks has not passed
            outcome, found = "FAIL", traceback.format_exc()
        if outcome == "FAIL":
            failed.append(name)
        print(f"{outcome} {time.monotonic() - started:6.1f} s  {name}{': ' + found if found else ''}", flush=True)
    return failed


def main():
    """The command line; its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True, help="the program to be checked")
    parser.add_argument("--pack", required=True, help="the terrain of the demonstration, as the program made it")
    parser.add_argument("--tests", required=True, help="Cargo's messages about the test programs")
    parser.add_argument("--out", required=True, help="where the pictures are kept")
    parser.add_argument("words", nargs="*", help="run only the checks whose names hold one of these words")
    options = parser.parse_args()
    chosen = [f for f in CHECKS if not options.words or any(word in f.__name__ for word in options.words)]
    for function in CHECKS:
        if function not in chosen:
            print(f"not asked for: {function.__name__.replace('_', ' ')}")
    shutil.rmtree(options.out, ignore_errors=True)
    os.makedirs(options.out)
    # Told to end, it ends the guest too.
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    started, guest = time.monotonic(), None
    try:
        kernel = machine.Kernel(os.path.join(os.environ["GLASSWING_CACHE"], "guest"))
        vkms.ensure(kernel)
        started = time.monotonic()
        guest = machine.Machine(kernel, WIDTH_PX, HEIGHT_PX)
        guest.boot()
        print(f"guest: Linux {guest.kernel.version} took commands after {time.monotonic() - started:.1f} s", flush=True)
        failed = run_checks(Bench(options, guest), chosen)
    except machine.GuestError as error:
        print(f"FAIL the virtual machine: {error}")
        return 1
    finally:
        if guest is not None:
            guest.stop()
    print(f"guest: {len(chosen) - len(failed)} of {len(chosen)} checks passed in {time.monotonic() - started:.0f} s; "
          f"the pictures are in {options.out}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
