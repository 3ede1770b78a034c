#!/bin/sh
# What install.sh and the package do last, on the machine itself: the user, compiled kernels, the services.
set -eu
systemd-sysusers /usr/lib/sysusers.d/irsd.conf
# compiled kernels: made once now, so that the first start is not late
install -d /var/cache/irsd
NUMBA_CACHE_DIR=/var/cache/irsd /opt/irsd/bin/python -m irsd.warm
chown -R irsd:irsd /var/cache/irsd
if [ -d /run/systemd/system ]; then
    systemctl daemon-reload
    systemctl enable irsd.service nav-bridge.service
    # restart, not start: an upgrade must take effect
    systemctl restart irsd.service nav-bridge.service
fi
