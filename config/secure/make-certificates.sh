#!/bin/sh
# An authority of your own and a certificate for each name: make-certificates.sh FOLDER [HOST-OR-IP ...] (where irsd is reached from).
# Run it on a computer that is safe; give each robot and person only ca.pem and their own .pem and .key. ca.key stays where it is.
set -eu
folder=${1:?usage: make-certificates.sh FOLDER [HOST-OR-IP ...]}
shift
days=${DAYS:-825}
names="DNS:localhost,IP:127.0.0.1"
for host in "$@"; do
    case $host in *[!0-9.]*) names="$names,DNS:$host" ;; *) names="$names,IP:$host" ;; esac
done
umask 077
mkdir -p "$folder"
cd "$folder"
[ -e ca.key ] || openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -sha256 -days "$days" \
    -subj "/CN=irsd authority" -addext "basicConstraints=critical,CA:true" -keyout ca.key -out ca.pem 2>/dev/null
for name in irsd nav-bridge sensors operator viewer; do
    [ -e "$name.key" ] && continue
    openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$name" -keyout "$name.key" -out "$name.csr" 2>/dev/null
    printf 'subjectAltName=%s\nextendedKeyUsage=serverAuth,clientAuth\nbasicConstraints=CA:false\n' "$names" > "$name.ext"
    openssl x509 -req -in "$name.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days "$days" -sha256 \
        -extfile "$name.ext" -out "$name.pem" 2>/dev/null
    rm "$name.csr" "$name.ext"
done
chmod 644 ca.pem
echo "in $folder: ca.pem, and NAME.pem + NAME.key for irsd nav-bridge sensors operator viewer"
