"""A virtual machine with Debian's own kernel, this machine's files and the devices this machine lacks.

The guest sees the whole file system of the host read-only, so what was built here runs there as it is. Nothing is
installed for it: the kernel package is fetched once into the cache and unpacked there.
"""

import glob
import gzip
import json
import lzma
import os
import re
import shutil
import socket
import subprocess
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))

# What the first process needs before it can reach anything else.
FIRST_MODULES = ["virtio_pci", "virtio_console", "9pnet_virtio", "9p", "overlay"]


class GuestError(Exception):
    """The machine itself failed; nothing was learnt about the program."""


def run(*words, **options):
    """Runs a tool of the host; its output, or a GuestError with what it said."""
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise GuestError(f"{' '.join(words)} ended with {done.returncode}: {(done.stderr or done.stdout).strip()}")
    return done.stdout


class Kernel:
    """Debian's kernel package, unpacked below `cache`."""

    def __init__(self, cache):
        ready = sorted(glob.glob(os.path.join(cache, "kernel-*", "ready")), key=os.path.getmtime)
        self.folder = os.path.dirname(ready[-1]) if ready else self._fetch(cache)
        self.modules = os.path.join(self.folder, "lib/modules")
        self.version = os.listdir(self.modules)[0]
        self.image = os.path.join(self.folder, "vmlinux")
        if not os.path.exists(self.image):
            self.image = os.path.join(self.folder, "boot", f"vmlinuz-{self.version}")

    @staticmethod
    def _package():
        """The name of the package that linux-image-amd64 stands for today, or None."""
        shown = subprocess.run(["apt-cache", "show", "linux-image-amd64"], capture_output=True, text=True).stdout
        found = re.search(r"^Depends:.*?(linux-image-\d[^ ,]*)", shown, re.MULTILINE)
        return found and found.group(1)

    @classmethod
    def _fetch(cls, cache):
        os.makedirs(cache, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache, prefix="fetch-") as scratch:
            for attempt in ("with the package lists as they are", "with new package lists"):
                package = cls._package()
                try:
                    if package is None:
                        raise GuestError("apt knows no linux-image-amd64")
                    print(f"guest: fetching {package} into {cache}", flush=True)
                    run("apt-get", "download", package, cwd=scratch)
                    break
                except GuestError as error:
                    if attempt.startswith("with new"):
                        raise
                    print(f"guest: {error}; renewing apt's package lists", flush=True)
                    run(*([] if os.geteuid() == 0 else ["sudo"]), "apt-get", "update")
            root = os.path.join(scratch, "root")
            run("dpkg-deb", "-x", glob.glob(os.path.join(scratch, "*.deb"))[0], root)
            version = os.listdir(os.path.join(root, "lib/modules"))[0]
            with open(os.path.join(root, "package-version"), "w") as file:
                file.write(run("dpkg-deb", "-f", glob.glob(os.path.join(scratch, "*.deb"))[0], "Version"))
            run("depmod", "-b", root, version)
            unpack_image(os.path.join(root, "boot", f"vmlinuz-{version}"), os.path.join(root, "vmlinux"))
            open(os.path.join(root, "ready"), "w").close()
            folder = os.path.join(cache, f"kernel-{version}")
            shutil.rmtree(folder, ignore_errors=True)
            os.rename(root, folder)
        return folder

    def module_files(self, names):
        """The files of modules and of all they need, in the order in which they load."""
        files = []
        for name in names:
            shown = run("modprobe", "-d", self.folder, "-S", self.version, "--show-depends", name)
            for line in shown.splitlines():
                words = line.split()
                if words[0] == "insmod" and words[1] not in files:
                    files.append(words[1])
        return files


def unpack_image(compressed, plain):
    """Writes the kernel that `compressed` holds, which QEMU can start directly: that halves the time to boot.

    Leaves nothing where the image is not packed with xz; the compressed one is then booted.
    """
    with open(compressed, "rb") as file:
        image = file.read()
    for start in re.finditer(re.escape(b"\xfd7zXZ\0"), image):
        try:
            kernel = lzma.LZMADecompressor().decompress(image[start.start() :])
        except lzma.LZMAError:
            continue
        if kernel.startswith(b"\x7fELF"):
            with open(plain, "wb") as file:
                file.write(kernel)
            return


def archive(entries):
    """A cpio archive in the "newc" format of the kernel's initramfs; `entries` are (name, mode, bytes)."""
    parts = []
    for number, (name, mode, content) in enumerate([*entries, ("TRAILER!!!", 0, b"")], 1):
        label = name.encode() + b"\0"
        fields = [number, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(label), 0]
        head = b"070701" + b"".join(b"%08X" % field for field in fields) + label
        parts += [head, b"\0" * (-len(head) % 4), content, b"\0" * (-len(content) % 4)]
    return b"".join(parts)


def first_files(kernel):
    """The initramfs: busybox, `init` and the modules it loads."""

    def content(path):
        with open(path, "rb") as file:
            return file.read()

    busybox = shutil.which("busybox") or "/bin/busybox"
    entries = [("bin", 0o40755, b""), ("bin/busybox", 0o100755, content(busybox))]
    entries.append(("init", 0o100755, content(os.path.join(HERE, "init"))))
    names = []
    for number, path in enumerate(kernel.module_files(FIRST_MODULES)):
        names.append(f"/{number:02}.ko")
        entries.append((names[-1][1:], 0o100644, content(path)))
    entries.append(("load-first", 0o100644, "".join(name + "\n" for name in names).encode()))
    return gzip.compress(archive(entries), compresslevel=1)


def acceleration():
    """KVM where the processor really offers it, else QEMU's own translation."""
    with open("/proc/cpuinfo") as file:
        flags = file.read()
    if re.search(r"\b(vmx|svm)\b", flags) and os.access("/dev/kvm", os.W_OK):
        return ["-accel", "kvm", "-cpu", "host"]
    return ["-accel", "tcg,thread=multi,tb-size=512", "-cpu", "max"]


class Job:
    """A shell script that runs in the guest."""

    def __init__(self, machine, name):
        self.machine, self.name = machine, name

    def _read(self, ending):
        try:
            with open(os.path.join(self.machine.exchange, self.name + ending), errors="replace") as file:
                return file.read()
        except FileNotFoundError:
            return ""

    def output(self):
        """All that it has printed so far."""
        return self._read(".out")

    def code(self):
        """Its exit status, or None while it runs."""
        text = self._read(".code").strip()
        return int(text) if text else None

    def wait(self, seconds=300):
        """Waits for its end and gives its exit status; past the time it is killed and the status is None."""
        until = time.monotonic() + seconds
        while self.code() is None:
            if time.monotonic() > until:
                self.kill()
                return None
            self.machine.must_run()
            time.sleep(0.1)
        return self.code()

    def kill(self):
        """Ends it and all it started, as a power cut would."""
        # dash takes `--` only after `-s`.
        killed = self.machine.start(f"kill -s KILL -- -$(cat /exchange/{self.name}.pid)").wait(30)
        if killed != 0 and self.code() is None:
            raise RuntimeError(f"{self.name} was not killed: {killed}")


class Machine:
    """A running guest: start it, give it scripts, look at its screen."""

    def __init__(self, kernel, width_px, height_px):
        self.kernel = kernel
        # Sockets have short names only, so this is not below the project.
        self.folder = tempfile.mkdtemp(prefix="glasswing-guest-")
        self.exchange = os.path.join(self.folder, "exchange")
        os.mkdir(self.exchange)
        shutil.copy(os.path.join(HERE, "agent"), self.exchange)
        self.console = os.path.join(self.folder, "console.log")
        self.count = 0
        initrd = os.path.join(self.folder, "initrd")
        with open(initrd, "wb") as file:
            file.write(first_files(self.kernel))
        self.log = open(os.path.join(self.folder, "qemu.log"), "w+")
        self.qemu = subprocess.Popen(
            self._command(initrd, width_px, height_px), stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log
        )

    def _command(self, initrd, width_px, height_px):
        def share(tag, path, options):
            keep = "security_model=none,multidevs=remap"
            return ["-virtfs", f"local,id={tag},mount_tag={tag},path={path},{keep}{options}"]

        boot = "console=ttyS0 quiet panic=-1 rdinit=/init mitigations=off audit=0 random.trust_cpu=1"
        return [
            "qemu-system-x86_64", "-machine", "q35,i8042=off", *acceleration(), "-smp", "2", "-m", "2048",
            "-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-vga", "none",
            "-kernel", self.kernel.image, "-initrd", initrd, "-append", boot, "-serial", f"file:{self.console}",
            *share("files", "/", ",readonly=on"),
            *share("modules", self.kernel.modules, ",readonly=on"),
            *share("exchange", self.exchange, ""),
            "-device", "virtio-serial-pci", "-device", "virtserialport,chardev=control,name=control",
            "-chardev", f"socket,id=control,path={self.folder}/control,server=on,wait=off",
            "-qmp", f"unix:{self.folder}/monitor,server=on,wait=off",
            "-device", f"virtio-gpu-pci,xres={width_px},yres={height_px}",
            # A USB socket for a serial adapter, which is plugged in while the host holds its far end; a port on the board.
            "-device", "qemu-xhci",
            "-chardev", f"socket,id=usb,path={self.folder}/usb,server=on,wait=off", "-device", "usb-serial,chardev=usb",
            "-chardev", "null,id=line", "-device", "isa-serial,chardev=line",
            # Two CAN controllers on one bus.
            "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus",
            "-device", "virtio-keyboard-pci", "-device", "virtio-tablet-pci", "-device", "virtio-rng-pci",
        ]  # fmt: skip

    def boot(self, seconds=180):
        """Waits until the guest takes commands."""
        self.control = self._connect("control")
        self.monitor = self._connect("monitor").makefile("rw")
        self.monitor.readline()  # QEMU's greeting
        self._monitor_call("qmp_capabilities")
        until = time.monotonic() + seconds
        while not os.path.exists(os.path.join(self.exchange, "ready")):
            if time.monotonic() > until:
                raise GuestError(f"the guest was not ready after {seconds} s\n{self.last_words()}")
            self.must_run()
            time.sleep(0.1)

    def _connect(self, name):
        until = time.monotonic() + 30
        while True:
            self.must_run()
            end = socket.socket(socket.AF_UNIX)
            try:
                end.connect(os.path.join(self.folder, name))
                return end
            except (FileNotFoundError, ConnectionRefusedError) as error:
                end.close()
                if time.monotonic() > until:
                    raise GuestError(f"QEMU does not answer on {name}") from error
                time.sleep(0.05)

    def _monitor_call(self, command, **arguments):
        self.monitor.write(json.dumps({"execute": command, "arguments": arguments}) + "\n")
        self.monitor.flush()
        while True:
            answer = json.loads(self.monitor.readline() or '{"error": {"desc": "it has ended"}}')
            if "error" in answer:
                raise GuestError(f"QEMU refuses {command}: {answer['error']['desc']}")
            if "return" in answer:
                return

    def plug_in(self):
        """Plugs the USB serial adapter in; its far end. Closing that pulls it out."""
        return self._connect("usb")

    def screenshot(self, path):
        """Writes what the guest's display shows now, as PNG, taken from the scanout by the host."""
        self._monitor_call("screendump", filename=os.path.abspath(path), format="png")

    def start(self, script):
        """Starts a shell script in the guest, as root, with / as its folder."""
        self.count += 1
        name = f"job{self.count}"
        with open(os.path.join(self.exchange, name + ".sh"), "w") as file:
            file.write(script + "\n")
        self.control.sendall(name.encode() + b"\n")
        return Job(self, name)

    def must_run(self):
        """Raises when the guest has ended."""
        if self.qemu.poll() is not None:
            raise GuestError(f"the guest ended by itself (QEMU: {self.qemu.returncode})\n{self.last_words()}")

    def last_words(self):
        """The end of the guest's console and of what QEMU said."""
        words = []
        for path in (self.console, self.log.name):
            if os.path.exists(path):
                with open(path, errors="replace") as file:
                    words += file.read().splitlines()[-12:]
        return "\n".join("  | " + word for word in words)

    def stop(self):
        """Ends the guest and removes its folder."""
        self.qemu.terminate()
        try:
            self.qemu.wait(10)
        except subprocess.TimeoutExpired:
            self.qemu.kill()
            self.qemu.wait()
        self.log.close()
        shutil.rmtree(self.folder, ignore_errors=True)
