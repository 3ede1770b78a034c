#!/bin/sh
# Installs irsd and nav-bridge as services: a venv in /opt/irsd, settings in /etc/irsd, the map in /var/lib/irsd.
# Usage: sudo systemd/install.sh [WHEEL-OR-SOURCE]   (default: the source tree this script is in)
set -eu

here=$(cd "$(dirname "$0")" && pwd)
source=${1:-$(dirname "$here")}
python=${PYTHON:-python3}

[ "$(id -u)" = 0 ] || { echo "install.sh: must run as root" >&2; exit 1; }
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "install.sh: Python 3.11 or newer is needed" >&2; exit 1; }

[ -x /opt/irsd/bin/python ] || "$python" -m venv /opt/irsd
/opt/irsd/bin/pip install --upgrade "$source"

install -D -m 0644 "$here/irsd.sysusers.conf" /usr/lib/sysusers.d/irsd.conf
systemd-sysusers /usr/lib/sysusers.d/irsd.conf
# compiled kernels: made once now, so that the first start is not late
install -d /var/cache/irsd
NUMBA_CACHE_DIR=/var/cache/irsd /opt/irsd/bin/python -m irsd.warm
chown -R irsd:irsd /var/cache/irsd
install -d -m 0755 /etc/irsd
for name in irsd.yaml nav_bridge.yaml; do
    # what the operator has written stays
    [ -e "/etc/irsd/$name" ] || [ ! -e "$here/../config/$name" ] || install -m 0644 "$here/../config/$name" "/etc/irsd/$name"
done
install -m 0644 "$here/irsd.service" "$here/nav-bridge.service" /etc/systemd/system/
ln -sf /opt/irsd/bin/irsctl /usr/local/bin/irsctl

systemctl daemon-reload
systemctl enable irsd.service nav-bridge.service
# restart, not start: an upgrade must take effect
systemctl restart irsd.service nav-bridge.service
echo "installed; see: systemctl status irsd, irsctl status"
