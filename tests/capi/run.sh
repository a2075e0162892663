#!/usr/bin/env bash
# Installs the C library as a user would, and holds it to what it promises: only its own symbols, headers that compile without a warning, every
# function with good and bad arguments, the example with g++ and clang++ against what the program renders, sanitizers, and valgrind.
#
#   tests/capi/run.sh            needs gcc, clang, cmake, valgrind and pkg-config, which it installs where it can
#
# Everything goes below target/capi. QUICK=1 leaves out the sanitizers and valgrind.
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$PWD
work=$root/target/capi
prefix=$work/prefix
mkdir -p "$work"

say() { printf 'capi: %s\n' "$*"; }

missing=
for tool in gcc g++ clang++ cmake valgrind pkg-config nm; do
    command -v "$tool" >/dev/null || missing="$missing $tool"
done
if [ -n "$missing" ]; then
    say "installing:$missing"
    apt-get -q update && apt-get -q install -y --no-install-recommends gcc g++ clang cmake make valgrind pkg-config binutils
fi
vendor-notes/install-cargo-c.sh "$work/cargo-c"

say 'installing the library'
rm -rf "$prefix"
# A directory of its own: cargo-c holds another cargo, whose results ours would not use, and throw away.
CARGO_TARGET_DIR=$work/build "$work/cargo-c/cargo-c" install --release --prefix="$prefix" --libdir="$prefix/lib"
export PKG_CONFIG_PATH=$prefix/lib/pkgconfig
export LD_LIBRARY_PATH=$prefix/lib
cargo build --release
program=$root/target/release/helmholtz

say 'symbols'
strange=$(nm -D --defined-only "$prefix/lib/libhelmholtz.so" | awk '{print $3}' | grep -v '^helmholtz_' || true)
[ -z "$strange" ] || { say "these symbols should not be exported: $strange"; exit 1; }
declared=$(grep -oE '\bhelmholtz_[a-z_]+\(' include/helmholtz.h | tr -d '(' | sort -u)
exported=$(nm -D --defined-only "$prefix/lib/libhelmholtz.so" | awk '{print $3}' | sort -u)
diff <(echo "$declared") <(echo "$exported") || { say 'the header and the library have different functions'; exit 1; }

say 'headers'
strict='-Wall -Wextra -pedantic -Werror -fsyntax-only'
for compiler in gcc clang; do "$compiler" -std=c99 $strict -x c "$prefix/include/helmholtz.h"; done
for compiler in g++ clang++; do
    "$compiler" -std=c++17 $strict -x c++ "$prefix/include/helmholtz.h"
    "$compiler" -std=c++20 $strict -x c++ "$prefix/include/helmholtz.hpp"
done

say 'every function, from C, C++ and with the static library'
printf 'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n' >"$work/triangle.ply"
run_test() { "$@" "$work/triangle.ply" "$work/test.exr" "$work/test.png"; }
strict='-O1 -g -Wall -Wextra -pedantic -Werror'
read -ra flags < <(pkg-config --cflags --libs helmholtz)
gcc -std=c99 $strict tests/capi/test.c -o "$work/test" "${flags[@]}" -lm
run_test "$work/test"
clang++ -std=c++17 $strict -x c++ tests/capi/test.c -x none -o "$work/test-cpp" "${flags[@]}" -lm
run_test "$work/test-cpp"
read -ra private < <(pkg-config --static --libs-only-l helmholtz | sed 's/-lhelmholtz//')
embree=$(ldd "$prefix/lib/libhelmholtz.so" | awk '/embree4/ {print $3}')
gcc -std=c99 $strict -I"$prefix/include" tests/capi/test.c -o "$work/test-static" "$prefix/lib/libhelmholtz.a" \
    -L"$(dirname "$embree")" -Wl,-rpath,"$(dirname "$embree")" "${private[@]}" -lm
run_test "$work/test-static"

build_example() { # COMPILER NAME FLAGS...
    cmake -S examples/cpp -B "$work/$2" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_COMPILER="$1" -DCMAKE_CXX_FLAGS="${*:3}" \
        -DCMAKE_BUILD_TYPE=RelWithDebInfo >/dev/null
    cmake --build "$work/$2" -- -s
    mkdir -p "$work/$2/frames"
}
for compiler in g++ clang++; do
    say "the example, by $compiler"
    build_example "$compiler" "example-$compiler" -Werror
    "$work/example-$compiler/turntable" "$work/example-$compiler/frames" "$program"
done
[ -z "${QUICK:-}" ] || exit 0

say 'AddressSanitizer and UndefinedBehaviorSanitizer'
sanitize='-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer'
build_example clang++ example-sanitized $sanitize
"$work/example-sanitized/turntable" "$work/example-sanitized/frames" '' 32 2
clang -std=c99 $strict $sanitize tests/capi/test.c -o "$work/test-sanitized" "${flags[@]}" -lm
run_test "$work/test-sanitized"

say 'valgrind'
checked=(valgrind -q --error-exitcode=1 --leak-check=full --show-leak-kinds=definite,indirect,possible
    --errors-for-leak-kinds=definite,indirect,possible --suppressions="$root/tests/capi/valgrind.supp")
run_test "${checked[@]}" "$work/test"
"${checked[@]}" "$work/example-g++/turntable" "$work/example-g++/frames" '' 12 1
say 'done'
