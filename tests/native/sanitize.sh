#!/bin/sh
# Compile the kernels with AddressSanitizer and UBSan, run the fuzz drivers. Usage: sanitize.sh BUILD_FOLDER
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$1"
cd "$1"
flags="-std=c++17 -O1 -g -pthread -I$root/cpp -ffp-contract=off -fno-math-errno -fno-trapping-math
    -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"
objects=""
compile() {  # SOURCE FLAGS...
    source=$1
    shift
    ${CXX:-c++} $flags "$@" -c "$root/$source.cpp" -o "$(basename "$source").o"
    objects="$objects $(basename "$source").o"
}
case $(uname -m) in
    x86_64)
        flags="$flags -DFACETCAM_X86"
        compile cpp/corner_kernels_avx2 -mavx2
        compile cpp/corner_kernels_avx512 -mavx512f -mavx512bw -mavx512vl -mavx512dq
        ;;
esac
for source in cpp/parallel cpp/corner_kernels cpp/corner_kernels_baseline cpp/corner_levels cpp/corners cpp/light cpp/matching \
    cpp/octaves cpp/selection tests/native/fuzz_features; do
    compile $source
done
${CXX:-c++} $flags $objects -o fuzz_features
./fuzz_features

objects=""
for source in cpp/parallel cpp/skyline cpp/pose $(cd "$root" && ls cpp/bundle*.cpp) tests/native/fuzz_bundle; do
    compile "${source%.cpp}"
done
${CXX:-c++} $flags $objects -o fuzz_bundle
./fuzz_bundle
