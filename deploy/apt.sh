# Sourced by setup scripts: installs Debian packages, as root or by sudo. The caller has `say`.
# apt_install PACKAGE... returns 3, having said what to do by hand, where it may not.
apt_install() {
    if [ "$(id -u)" = 0 ]; then
        as_root=
    elif sudo -n true 2>/dev/null; then
        as_root="sudo -n"
    else
        say "these Debian packages are missing: $*"
        say "install them as root: apt-get install --no-install-recommends $*"
        return 3
    fi
    command -v apt-get >/dev/null || { say "no apt-get here; install by hand: $*"; return 3; }
    say "installing Debian packages: $*"
    $as_root apt-get update -qq || return
    DEBIAN_FRONTEND=noninteractive $as_root apt-get install -y -qq --no-install-recommends \
        "$@" >/dev/null
}
