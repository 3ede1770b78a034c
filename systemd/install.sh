#!/bin/sh
# Installs irsd and nav-bridge as services: a venv in /opt/irsd, settings in /etc/irsd, the map in /var/lib/irsd.
#   sudo systemd/install.sh [WHEEL-OR-SOURCE]   install or upgrade (default: the source tree this script is in); settings stay
#   sudo systemd/install.sh --uninstall         programs and units go, settings and maps stay
#   sudo systemd/install.sh --purge             everything goes, settings and maps too
# DESTDIR=DIR installs below DIR, for images and tests; PYTHON=python3.x chooses the interpreter,
# LOCK=FILE the list of exact versions (none there: those that pip resolves).
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=${DESTDIR:-}
python=${PYTHON:-python3}
opt=$root/opt/irsd etc=$root/etc/irsd units=$root/etc/systemd/system
services="irsd.service nav-bridge.service"

say() { echo "install.sh: $*"; }
fail() { echo "install.sh: $*" >&2; exit 1; }
running_systemd() { [ -z "$root" ] && [ -d /run/systemd/system ]; }

[ "$(id -u)" = 0 ] || [ -n "$root" ] || fail "must run as root: sudo $0 $*"

uninstall() {
    if running_systemd; then
        systemctl disable --now $services 2>/dev/null || true
    fi
    for unit in $services; do rm -f "$units/$unit"; done
    rm -rf "$opt" "$root/var/cache/irsd" "$root/usr/lib/sysusers.d/irsd.conf"
    for name in irsctl irsd nav-bridge; do
        [ "$(readlink "$root/usr/local/bin/$name" || true)" != "/opt/irsd/bin/$name" ] || rm "$root/usr/local/bin/$name"
    done
    if running_systemd; then systemctl daemon-reload; fi
}

case ${1:-} in
--uninstall)
    uninstall
    say "removed; settings are in $etc, maps in $root/var/lib/irsd (--purge removes them)"
    exit 0 ;;
--purge)
    uninstall
    rm -rf "$etc" "$root/var/lib/irsd" "$root/var/lib/nav-bridge"
    say "removed, settings and maps too"
    exit 0 ;;
-*) fail "unknown option $1 (see the top of this file)" ;;
esac

source=${1:-$(dirname "$here")}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "Python 3.11 or newer is needed: PYTHON=python3.x $0"

# the venv is made anew when its interpreter is gone (an upgrade of the system), never while it works
"$opt/bin/python" -c '' 2>/dev/null || { rm -rf "$opt"; "$python" -m venv "$opt" || fail "apt-get install python3-venv"; }
# the exact versions that were tested, where they are known: then irsd itself over them
lock=${LOCK:-$here/../requirements.lock}
[ ! -e "$lock" ] || "$opt/bin/python" -m pip install -q --no-deps -r "$lock"
"$opt/bin/python" -m pip install -q --upgrade "$source"

install -d -m 0755 "$etc" "$units" "$root/usr/lib/sysusers.d" "$root/usr/local/bin"
install -m 0644 "$here/irsd.sysusers.conf" "$root/usr/lib/sysusers.d/irsd.conf"
for name in irsd.yaml nav_bridge.yaml; do
    # what the operator has written stays; what is new lies beside it
    if [ ! -e "$here/../config/$name" ]; then continue; fi
    if [ -e "$etc/$name" ] && ! cmp -s "$etc/$name" "$here/../config/$name"; then
        install -m 0644 "$here/../config/$name" "$etc/$name.new"
    else
        install -m 0644 "$here/../config/$name" "$etc/$name"
    fi
done
for unit in $services; do install -m 0644 "$here/$unit" "$units/$unit"; done
for name in irsctl irsd nav-bridge; do ln -sf "/opt/irsd/bin/$name" "$root/usr/local/bin/$name"; done
if [ -n "$root" ]; then
    say "installed below $root; on the machine itself: systemd-sysusers, systemctl enable --now $services"
    exit 0
fi
sh "$here/after-install.sh"
say "installed; see: systemctl status irsd, irsctl status, irsctl doctor"
