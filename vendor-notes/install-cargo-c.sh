#!/usr/bin/env bash
# Makes cargo-c available, which builds and installs the C library, without compiling it (that takes longer than Helmholtz itself).
#
#   vendor-notes/install-cargo-c.sh DIR      leaves DIR/cargo-c, to be called as `cargo-c install --release --prefix=...`
#
# Where cargo-c is installed, that one is used. Debian 13 and Ubuntu 24.04 have a package: apt-get install cargo-c. Debian 12's is too old for
# Rust's edition of 2024: there, on amd64, Debian 13's package is unpacked in DIR with all the libraries that it needs, its own C library among them.
set -euo pipefail

[ $# -eq 1 ] || { echo "usage: $0 DIR" >&2; exit 2; }
mkdir -p "$1"
directory=$(cd "$1" && pwd)
release=trixie

say() { printf 'install-cargo-c: %s\n' "$*"; }
fail() { printf 'install-cargo-c: error: %s\n' "$*" >&2; exit 1; }
as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }
# shellcheck source=vendor-notes/other-debian.sh
. "$(dirname "$0")/other-debian.sh"
# shellcheck source=/dev/null
. /etc/os-release

if [ -x "$directory/cargo-c" ]; then
    say "nothing to do: $directory/cargo-c is there"
    exit 0
fi
if command -v cargo-capi >/dev/null; then
    printf '#!/bin/sh\nexec cargo-capi capi "$@"\n' >"$directory/cargo-c"
else
    [ "${VERSION_CODENAME:-}" = bookworm ] && [ "$(dpkg --print-architecture)" = amd64 ] \
        || fail 'install cargo-c first: apt-get install cargo-c, or cargo install cargo-c'
    other_debian "$directory" "$release"
    say "downloading Debian $release's cargo-c and what it needs"
    apt-get -q -c "$directory/apt/apt.conf" install --download-only -y --no-install-recommends cargo-c >/dev/null
    for package in "$directory"/apt/archives/*.deb; do dpkg -x "$package" "$directory/root"; done
    # Beside the C library are the others and their loader, which on amd64 (above) is called so.
    libraries=$(dirname "$(find "$directory/root" -name libc.so.6 -print -quit)")
    printf '#!/bin/sh\nexec "%s/ld-linux-x86-64.so.2" --library-path "%s" "%s/usr/bin/cargo-capi" capi "$@"\n' \
        "$libraries" "$libraries" "$directory/root" >"$directory/cargo-c"
fi
chmod +x "$directory/cargo-c"
say "done: $("$directory/cargo-c" --version)"
