#!/usr/bin/env bash
# Installs what Helmholtz needs to build with Intel Embree 4: the library, its headers, and libclang for bindgen.
#
#   vendor-notes/install-embree.sh                 into /usr/local as root, else into ~/.local
#   PREFIX=/some/where vendor-notes/install-embree.sh     (then build with EMBREE_DIR=/some/where)
#
# Where the distribution has Embree 4 (Debian 13, Ubuntu 24.04 and newer) its packages are used, and PREFIX is not.
# Debian 12 has Embree 3.13 only: there the library comes from a Python wheel and the headers from Debian 13's package.
# Why these two: embree.md, beside this file. Running it again changes nothing and needs no network.
set -euo pipefail

wheel='embreex==4.4.0.post1'
wheel_sha256=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f
# The wheel's build tool put a hash into these names, and the libraries refer to each other by them. They must stay.
embree_library=libembree4-4aef3270.so.4
tbb_library=libtbb-dcf63f8c.so.12
headers_release=trixie
# shellcheck source=vendor-notes/other-debian.sh
. "$(dirname "$0")/other-debian.sh"

say() { printf 'install-embree: %s\n' "$*"; }
fail() { printf 'install-embree: error: %s\n' "$*" >&2; exit 1; }

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        say "with sudo: $*"
        sudo "$@"
    else
        fail "this needs root, and there is no sudo; as root, run: $*"
    fi
}

installed() { # PACKAGE... : whether dpkg has one of these (patterns allowed)
    dpkg-query -W -f '${db:Status-Status}\n' "$@" 2>/dev/null | grep -qx installed
}

apt_install() {
    apt_update
    say "installing by apt: $*"
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends "$@"
}

# bindgen needs libclang and clang's own headers (stddef.h); the -dev packages hold both.
have_libclang() { installed libclang-dev 'libclang-[0-9]*-dev'; }

have_embree() { # PREFIX : whether build.rs will find Embree 4 there
    grep -qsE '^#define RTC_VERSION_MAJOR 4$' "$1/include/embree4/rtcore_config.h" || return 1
    local library
    for library in "$1"/lib/libembree4.so "$1"/lib64/libembree4.so "$1"/lib/*-linux-gnu/libembree4.so; do
        [ ! -e "$library" ] || return 0
    done
    return 1
}

embree_candidate() { # the version of libembree-dev that apt would install, if any
    LC_ALL=C apt-cache policy libembree-dev 2>/dev/null | sed -n 's/^ *Candidate: //p' | grep -vx '(none)' || true
}

download_wheel() { # DIR : leaves the unpacked wheel in DIR/wheel
    python3 -m pip --version >/dev/null 2>&1 || apt_install python3-pip
    say "downloading the wheel $wheel"
    # The Python version is named so that the file, and with it the checksum, does not depend on the Python found here.
    python3 -m pip download --quiet --no-deps --only-binary=:all: --implementation cp --python-version 311 \
        --platform manylinux_2_28_x86_64 --dest "$1" "$wheel"
    local file
    file=$(echo "$1"/embreex-*.whl)
    printf '%s  %s\n' "$wheel_sha256" "$file" | sha256sum --check --quiet || fail "$file has another checksum than expected"
    python3 -m zipfile -e "$file" "$1/wheel"
}

download_headers() { # DIR : leaves Debian 13's libembree-dev unpacked in DIR/headers
    say "downloading Debian $headers_release's libembree-dev (headers only; apt's own lists are not touched)"
    mkdir -p "$1/headers"
    other_debian "$1" "$headers_release"
    (cd "$1/headers" && apt-get -q -c ../apt/apt.conf download libembree-dev && dpkg -x libembree-dev_*.deb .)
}

install_from_wheel() {
    local work as_owner=
    work=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory is known now, and local
    trap "rm -rf '$work'" EXIT
    download_wheel "$work"
    download_headers "$work"
    mkdir -p "$prefix" 2>/dev/null || true
    [ -w "$prefix" ] || as_owner=as_root
    say "installing into $prefix"
    $as_owner install -d "$prefix/lib" "$prefix/include/embree4"
    $as_owner install -m 644 "$work"/headers/usr/include/embree4/*.h "$prefix/include/embree4"
    $as_owner install -m 644 "$work/wheel/embreex.libs/$tbb_library" "$work/wheel/embreex.libs/$embree_library" "$prefix/lib"
    # Last, because it is what marks the installation as complete.
    $as_owner ln -sfn "$embree_library" "$prefix/lib/libembree4.so"
}

command -v apt-get >/dev/null || fail 'this machine has no apt; install Embree 4 and libclang yourself and set EMBREE_DIR'

default_prefix=/usr/local
[ "$(id -u)" -eq 0 ] || default_prefix=$HOME/.local
prefix=${PREFIX:-$default_prefix}
case $prefix in /*) ;; *) fail "PREFIX must be an absolute path: $prefix" ;; esac

have_libclang || apt_install libclang-dev

# A prefix that was asked for must itself hold Embree; else any place counts in which build.rs looks.
places=("$prefix")
[ -n "${PREFIX:-}" ] || places+=("${HOME:-}/.local" /usr/local /usr)
for place in "${places[@]}"; do
    if have_embree "$place"; then
        say "nothing to do: Embree 4 is in $place, and libclang is installed"
        exit 0
    fi
done

candidate=$(embree_candidate)
if [ -z "$candidate" ]; then
    apt_update
    candidate=$(embree_candidate)
fi
if [ -n "$candidate" ] && dpkg --compare-versions "$candidate" ge 4; then
    apt_install libembree-dev
    have_embree /usr || fail "libembree-dev $candidate is installed, but its header or library is not where expected"
    say "done: Embree $candidate of the distribution"
    exit 0
fi

# shellcheck source=/dev/null
. /etc/os-release
say "the distribution (${PRETTY_NAME:-unknown}) has Embree ${candidate:-not at all}; 4 is needed"
[ "$ID" = debian ] || fail 'only Debian 12 is provided for; install Embree 4 yourself and set EMBREE_DIR to its prefix'
[ "$(dpkg --print-architecture)" = amd64 ] \
    || fail "the wheel holds x86-64 code and this is $(dpkg --print-architecture); use Debian 13 or newer, or set EMBREE_DIR to an Embree 4 of your own"
install_from_wheel
say "done: Embree 4.4.0 with headers of 4.3 or newer in $prefix"
