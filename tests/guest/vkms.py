"""Builds vkms, the kernel's display without a screen, which Debian's kernels leave out.

virtio-gpu has no vertical blank; vkms has one at 60 Hz. It is one small module: its source comes from Debian's kernel
source package, in the version of the kernel, and only the built module is kept.
"""

import glob
import os
import shutil
import subprocess
import tempfile

from machine import GuestError, run

FOLDER = "drivers/gpu/drm/vkms"


def unpack(scratch, package, version):
    """Fetches a package of that version and unpacks it below `scratch`."""
    run("apt-get", "download", f"{package}={version}", cwd=scratch)
    run("dpkg-deb", "-x", glob.glob(os.path.join(scratch, f"{package}_*.deb"))[0], scratch)


def source(scratch, series):
    """The module's own source out of the packed kernel source."""
    packed = os.path.join(scratch, f"usr/src/linux-source-{series}.tar.xz")
    run("tar", "-xJf", packed, "-C", scratch, f"linux-source-{series}/{FOLDER}")
    return os.path.join(scratch, f"linux-source-{series}", FOLDER)


def ensure(kernel):
    """Builds the module for `kernel` unless it is there; takes half a minute and 150 MB of download, once."""
    built = os.path.join(kernel.modules, kernel.version, "kernel", f"{FOLDER}.ko")
    if os.path.exists(built):
        return
    print("guest: building vkms for the guest's kernel", flush=True)
    release, flavour = kernel.version.rsplit("-", 1)
    series = ".".join(release.split(".")[:2])
    with open(os.path.join(kernel.folder, "package-version")) as file:
        version = file.read().strip()
    with tempfile.TemporaryDirectory(dir=os.path.dirname(kernel.folder), prefix="vkms-") as scratch:
        for package in (f"linux-headers-{release}-{flavour}", f"linux-headers-{release}-common",
                        f"linux-kbuild-{series}", f"linux-source-{series}"):  # fmt: skip
            unpack(scratch, package, version)
        headers = os.path.join(scratch, "usr/src", f"linux-headers-{kernel.version}")
        makefile = os.path.join(headers, "Makefile")  # it looks for the common headers where a package puts them
        with open(makefile) as file:
            text = file.read()
        with open(makefile, "w") as file:
            file.write(text.replace("/usr/src/", os.path.join(scratch, "usr/src/")))
        module = source(scratch, series)
        words = ["make", "-s", "-C", headers, f"M={module}", "CONFIG_DRM_VKMS=m", "modules"]
        made = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        made_file = os.path.join(module, "vkms.ko")
        if made.returncode != 0 or not os.path.exists(made_file):
            raise GuestError(f"vkms does not build:\n{made.stdout[-2000:]}{made.stderr[-2000:]}")
        run("strip", "--strip-debug", made_file)
        shutil.move(made_file, built)
    run("depmod", "-b", kernel.folder, kernel.version)
