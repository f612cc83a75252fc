# Sourced by setup scripts: installs from locks, whose hashes every file must have. The caller has
# `say` and `venv`.
# locked_pip COMMAND [OPTION...] is `pip COMMAND --require-hashes`; a file of another hash ends it
# with what to do.
locked_pip() {
    command=$1
    shift
    log=$venv/pip.log
    if $venv/bin/python -m pip --disable-pip-version-check "$command" --quiet --require-hashes "$@" \
        2>"$log"; then
        cat "$log" >&2
        return 0
    fi
    cat "$log" >&2
    wrong=$(sed -n '/DO NOT MATCH THE HASHES/,$ s/^    \([^ ][^ ]*\) from .*/\1/p' "$log" | tr '\n' ' ')
    [ -n "$wrong" ] || return 1
    say "refused: ${wrong% } is not the file that the lock pins, and may have been tampered with."
    say "Look where pip takes it from (above): a mirror or a folder (pip config list,"
    say "PIP_FIND_LINKS='${PIP_FIND_LINKS:-}') may hold a file that was packed anew: take that away, and run it again."
    say "The hashes of the package's own files stand on https://pypi.org/project/${wrong%%==*}/#files;"
    say "only where the lock is wrong, write it anew: make lock"
    return 1
}
