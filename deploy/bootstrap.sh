#!/bin/sh
# Make the environment in .venv match requirements.lock; do nothing where it does already.
#
# Works on a fresh Debian or Ubuntu (x86_64, aarch64). System packages are installed only where
# they are missing, and only as root or with sudo that asks for no password; otherwise this says
# which to install and ends.
set -eu
cd "$(dirname "$0")/.."

venv=.venv
stamp=$venv/.lock-stamp
wanted=$(cat requirements.lock pyproject.toml deploy/bootstrap.sh | sha256sum | cut -d' ' -f1)
if [ -x "$venv/bin/bladescout" ] && [ "$(cat "$stamp" 2>/dev/null || :)" = "$wanted" ]; then
    exit 0
fi

say() { printf '%s\n' "$*" >&2; }
end() { say "error: $*"; exit 1; }

# Install system packages, or return 1 where we may not (no apt, no root, no sudo).
apt_install() {
    command -v apt-get >/dev/null 2>&1 || return 1
    if [ "$(id -u)" = 0 ]; then
        as_root=
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        as_root="sudo -n"
    else
        return 1
    fi
    say "Installing system packages: $*"
    $as_root apt-get update -qq >/dev/null 2>&1 || :
    $as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# A Python for which every package of the lock has a wheel.
usable='import sys; sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14) and sys.maxsize > 2**32))'
find_python() {
    for candidate in ${PYTHON:-} python3.11 python3.12 python3.13 python3.14 python3; do
        if "$candidate" -c "$usable" >/dev/null 2>&1; then
            command -v "$candidate"
            return 0
        fi
    done
    return 1
}

if ! python=$(find_python); then
    apt_install python3 python3-venv || :
    python=$(find_python) || end "Python 3.11 to 3.14 is needed and was not found." \
        "Install it, for example with: sudo apt-get install python3 python3-venv" \
        "(Debian 12, Ubuntu 24.04 or newer), or name one: make env PYTHON=/path/to/python3.11"
fi
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
if ! "$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then
    apt_install "python$version-venv" || apt_install python3-venv || :
    "$python" -c 'import ensurepip, venv' >/dev/null 2>&1 || end "$python has no venv module." \
        "Install it with: sudo apt-get install python$version-venv"
fi

# An environment of a Python that is gone, or of another version, is made anew.
if ! "$venv/bin/python" -c "$usable" >/dev/null 2>&1 || ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
    say "Creating $venv with Python $version ($python)"
    rm -rf "$venv"
    "$python" -m venv "$venv"
fi
rm -f "$stamp"

say "Installing the packages of requirements.lock into $venv (about 400 MB to fetch; a few minutes)"
"$venv/bin/python" -m pip --disable-pip-version-check install --quiet \
    --require-hashes --only-binary :all: -r requirements.lock ||
    end "the packages could not be installed; what pip said stands above." \
        "A network that reaches the Python package index is needed once."
"$venv/bin/python" -m pip --disable-pip-version-check install --quiet \
    --no-deps --no-build-isolation --editable . ||
    end "bladescout itself could not be installed; what pip said stands above."

# Open3D links system libraries that a bare machine lacks (libusb comes with a wheel).
packages_missing() {
    find "$venv/" -path '*/open3d/*' \( -name 'libOpen3D.so*' -o -name 'pybind*.so' \) \
        -exec ldd {} + 2>/dev/null | awk '/not found/ { print $1 }' | sort -u |
        while read -r library; do
            case $library in
                libGL.so.1) echo libgl1 ;;
                libEGL.so.1) echo libegl1 ;;
                libX11.so.6) echo libx11-6 ;;
                libgomp.so.1) echo libgomp1 ;;
            esac
        done
}
missing=$(packages_missing)
if [ -n "$missing" ]; then
    # shellcheck disable=SC2086 # one word a package
    apt_install $missing || end "Open3D needs system libraries that are not installed." \
        "Install them with: sudo apt-get install $(echo $missing)"
fi
"$venv/bin/python" -c '
import sys
from drivers.open3d_runtime import Open3dUnavailable, load_open3d
try:
    load_open3d()
except Open3dUnavailable as error:
    sys.exit(f"error: {error}")
'
say "Compiling the numerical kernels, once (about a minute)"
"$venv/bin/python" -c '
from config.settings import Settings
from perception.warm_up import warm_up_estimation, warm_up_tracking
warm_up_tracking()
warm_up_estimation(Settings())
'
printf '%s\n' "$wanted" >"$stamp"
say "The environment is ready: $venv"
