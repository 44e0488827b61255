#!/usr/bin/env bash
# Shared libraries that the wheels of the extras expect from the system (Open3D's, all of them).
# Installs what is missing where root or passwordless sudo allows; else says what to install and fails.
set -euo pipefail
python=${1:-python3}

libraries="libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 libX11.so.6:libx11-6
           libgomp.so.1:libgomp1 libidn2.so.0:libidn2-0 libudev.so.1:libudev1"

missing=()
for entry in $libraries; do
    "$python" -c "import ctypes, sys; ctypes.CDLL(sys.argv[1])" "${entry%%:*}" 2>/dev/null || missing+=("${entry##*:}")
done
[ ${#missing[@]} -eq 0 ] && exit 0

if ! command -v apt-get >/dev/null; then
    echo "error: system libraries are missing (Debian's names: ${missing[*]}); install them with your package manager" >&2
    exit 1
elif [ "$(id -u)" -eq 0 ]; then
    as_root=()
elif sudo -n true 2>/dev/null; then
    as_root=(sudo -n)
else
    echo "error: system libraries are missing; install them, then repeat: sudo apt-get install ${missing[*]}" >&2
    exit 1
fi
echo "installing system libraries: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
