#!/bin/sh
# Builds build/irsd_VERSION_ARCH.deb: systemd/build-deb.sh [WHEEL-OR-SOURCE]   (or: make deb)
# The package carries the whole venv, so that a robot without a network can install it: dpkg -i, nothing is downloaded there.
# It fits the Debian or Ubuntu release whose Python built it (the package depends on that python3.x).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
tree=$(dirname "$here")
python=${PYTHON:-python3}
build=$tree/build
stage=$build/deb

command -v dpkg-deb >/dev/null || { echo "build-deb.sh: apt-get install dpkg" >&2; exit 1; }
rm -rf "$stage"
mkdir -p "$stage/DEBIAN"
DESTDIR=$stage PYTHON=$python sh "$here/install.sh" "${1:-$tree}" >/dev/null
# scripts begin with the interpreter's path: that of the robot, not of this build
grep -rlZ "$stage/opt/irsd" "$stage/opt/irsd/bin" "$stage/opt/irsd/pyvenv.cfg" | xargs -0 -r sed -i "s|$stage||g"
find "$stage/opt/irsd" -name __pycache__ -type d -prune -exec rm -rf {} +
rm -f "$stage/etc/irsd/"*.new
mkdir -p "$stage/usr/lib/systemd/system" "$stage/usr/bin"
mv "$stage/etc/systemd/system/"*.service "$stage/usr/lib/systemd/system/"
rm -rf "$stage/etc/systemd" "$stage/usr/local"
for name in irsctl irsd nav-bridge; do ln -sf "/opt/irsd/bin/$name" "$stage/usr/bin/$name"; done
install -m 0755 "$here/after-install.sh" "$stage/opt/irsd/after-install.sh"

version=$("$stage/opt/irsd/bin/python" -c 'from importlib.metadata import version; print(version("irsd"))')
needs=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
arch=$(dpkg --print-architecture)
cat > "$stage/DEBIAN/control" <<CONTROL
Package: irsd
Version: $version
Architecture: $arch
Maintainer: The irsd developers <irsd@localhost>
Depends: $needs, systemd
Installed-Size: $(du -sk "$stage" | cut -f1)
Section: science
Priority: optional
Description: live scene graph of a building from a robot's sensors
 irsd, nav-bridge and irsctl with everything they need in /opt/irsd.
CONTROL
# dpkg keeps what the operator has changed in these, and asks
(cd "$stage" && find etc -type f -printf '/%p\n') > "$stage/DEBIAN/conffiles"
printf '#!/bin/sh\nset -e\n[ "$1" != configure ] || sh /opt/irsd/after-install.sh\n' > "$stage/DEBIAN/postinst"
printf '#!/bin/sh\nset -e\n[ "$1" = upgrade ] || [ ! -d /run/systemd/system ] || systemctl disable --now irsd.service nav-bridge.service || true\n' \
    > "$stage/DEBIAN/prerm"
printf '#!/bin/sh\nset -e\n[ "$1" != remove ] && [ "$1" != purge ] || rm -rf /opt/irsd /var/cache/irsd\n[ "$1" != purge ] || rm -rf /var/lib/irsd /var/lib/nav-bridge /etc/irsd\n[ ! -d /run/systemd/system ] || systemctl daemon-reload\n' \
    > "$stage/DEBIAN/postrm"
chmod 0755 "$stage/DEBIAN/postinst" "$stage/DEBIAN/prerm" "$stage/DEBIAN/postrm"
dpkg-deb --root-owner-group -Zxz -z1 --build "$stage" "$build/irsd_${version}_${arch}.deb"
rm -rf "$stage"
