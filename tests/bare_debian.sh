#!/bin/sh
# The README's two commands as a newcomer runs them: a clone of the last commit, in a Debian that has nothing but what the README
# names, with an empty environment. Takes half an hour. The root folder is removed afterwards.
set -eu
cd "$(dirname "$0")/.."
if [ "$(id -u)" != 0 ]; then
  echo "a bare Debian is made by root alone: skipped"
  exit 0
fi
command -v mmdebstrap >/dev/null || apt-get install -y -qq mmdebstrap >/dev/null
bare=$(mktemp -d)
trap 'rm -rf --one-file-system "$bare"' EXIT
trap 'exit 1' HUP INT TERM
mmdebstrap --quiet --variant=minbase --include=make,gcc,libc6-dev,python3-venv,git,ca-certificates bookworm "$bare"
git clone --quiet . "$bare/root/ergon"
# Rust as rustup installs it, and how this machine reaches the package registries.
cp -a "$(rustc --print sysroot)" "$bare/opt/rust"
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
  [ ! -e "$file" ] || cp --dereference "$file" "$bare$file"
done
# Mounts of a namespace of its own: they go with the last process.
unshare --mount --pid --fork sh -eu -c '
  mount -t proc proc "$0/proc"
  mount --rbind /dev "$0/dev"
  mount -t tmpfs tmpfs "$0/tmp"
  chroot "$0" env -i HOME=/root PATH=/opt/rust/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    sh -eu -c "cd ~/ergon && make demo && make test"
' "$bare"
