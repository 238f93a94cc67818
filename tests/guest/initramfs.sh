#!/bin/sh
# initramfs.sh: $kernel/initramfs.gz, a guest's whole world, a few MiB: busybox, our programs with their libraries, the kernel's modules for
# UIO and virtual disks and ours, and the guests' parts of the tests. Where the kernel came with a busybox of its own, as one of another
# architecture does, it is without our programs, and only the way to a disk with them.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
image=$kernel/initramfs.gz
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
chmod 755 "$tree"
mkdir -p "$tree/bin" "$tree/guest" "$tree/etc"
busybox=/bin/busybox
[ ! -e "$kernel/root/bin/busybox" ] || { busybox=$kernel/root/bin/busybox && programs=; }
cp "$busybox" "$tree/bin/busybox"
cp "$here/inside/init" "$tree/init"
cp "$here"/inside/*.sh "$here/functions.sh" "$root/docs/first-board.md" "$tree/guest/"

for program in "$programs/pmacd" "$programs/pmacctl" "$cache/latency"; do
	[ -n "$programs" ] && [ -e "$program" ] || continue
	strip -o "$tree/bin/${program##*/}" "$program"
	for library in $(ldd "$program" | sed -n 's/.* => \(\/[^ ]*\) .*/\1/p; s/^\s*\(\/[^ ]*\) .*/\1/p'); do
		[ -e "$tree$library" ] || { mkdir -p "$tree${library%/*}" && cp -L "$library" "$tree$library"; }
	done
done

"$here/modules.sh" "$tree" uio_pci_generic virtio_blk virtio_console virtio_pci ext4 crc32c_generic

(cd "$tree" && find . | cpio --quiet -o -H newc -R 0:0) | gzip -1 >"$image.new"
mv "$image.new" "$image"
