#!/usr/bin/env bash
# Runs fuzz targets side by side, each on one thread, for some seconds: fuzz/run.sh 3600 [xml obj ply serialized image]
# Needs a nightly toolchain and cargo-fuzz (`cargo install cargo-fuzz`). Starts from fuzz/seeds, the scenes and images of the tests, and the small
# third-party files beside the project if they are there. What is found lies in fuzz/artifacts; once mended, it goes into tests/data/regressions.
set -euo pipefail
cd "$(dirname "$0")"
seconds=$1
shift
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(xml obj ply serialized image)
third=../../shared/testdata/malformed
# A folder in memory if there is one: targets write their input to files.
[ -d /dev/shm ] && export TMPDIR=/dev/shm
# Without `-C target-cpu`, and with the address sanitizer.
cargo +nightly fuzz build --fuzz-dir .
for target in "${targets[@]}"; do
  corpora=("corpus/$target")
  limit=20000
  case $target in
    xml) corpora+=(seeds/xml ../tests/scenes "$third"/xml-*) ;;
    obj) corpora+=(seeds/obj "$third"/obj-*) ;;
    ply) corpora+=(seeds/ply "$third"/ply-*) ;;
    serialized) corpora+=(seeds/serialized) ;;
    image) corpora+=(../tests/scenes/textures "$third"/exr-* "$third"/png-* "$third"/jpg-*) limit=100000 ;;
  esac
  found=()
  for folder in "${corpora[@]}"; do [ -d "$folder" ] && found+=("$folder"); done
  mkdir -p "corpus/$target" "artifacts/$target"
  options=(-max_total_time="$seconds" -rss_limit_mb=1024 -timeout=5 -max_len="$limit" -artifact_prefix="artifacts/$target/")
  [ "$target" = xml ] && options+=(-dict=xml.dict)
  target/*/release/"$target" "${options[@]}" "corpus/$target" "${found[@]}" >"artifacts/$target.log" 2>&1 &
done
wait
