#!/bin/sh
# packages.sh [--look]: installs by apt-get what the guests need and the machine lacks. Package sources stay as they are.
#   --look: installs nothing, tells by its exit status whether anything is missing
set -eu
PATH=$PATH:/usr/sbin:/sbin
missing=
needs() { # PROGRAM PACKAGE
	command -v "$1" >/dev/null || missing="$missing $2"
}
needs qemu-system-x86_64 qemu-system-x86
needs cpio cpio
needs depmod kmod
needs make make
needs gcc gcc
needs strip binutils
needs xz xz-utils
needs mmdebstrap mmdebstrap
needs mke2fs e2fsprogs
needs iasl acpica-tools
# The shared one that some machines have cannot be the only program of a guest.
[ "$(dpkg-query -W -f '${db:Status-Abbrev}' busybox-static 2>/dev/null)" = 'ii ' ] || missing="$missing busybox-static"

if [ "${1-}" = --look ]; then
	[ -z "$missing" ]
	exit
fi
export DEBIAN_FRONTEND=noninteractive
# The kernel is looked up in the package lists too, so that they are wanted even if nothing is missing.
if [ -n "$missing" ] || ! apt-cache show linux-image-cloud-amd64 >/dev/null 2>&1; then
	apt-get update -qq
fi
# shellcheck disable=SC2086
[ -z "$missing" ] || apt-get install -y -qq --no-install-recommends $missing
