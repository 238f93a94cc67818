#!/bin/sh
# system_image.sh PART ARCHITECTURE IMAGE: a disk with a minimal Debian (systemd, udev, no D-Bus), our package beside it as /pmac.deb, users of all
# roles. What the machine does is inside/PART.sh.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
part=$1
architecture=$2
image=$3
deb=$(ls -t "$root"/target/debian/pmac-dpram_*_"$architecture".deb | head -n 1)

base=$cache/debian-$architecture.tar
if [ ! -f "$base" ]; then
	# A processor of 64 bits runs the programs for 32 bits, which mmdebstrap would have proved by another package.
	mmdebstrap --quiet --mode=root --architecture="$architecture" --skip=check/qemu --variant=essential --include=systemd-sysv,udev,kmod \
		--aptopt='APT::Install-Recommends "false"' \
		--dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
		--dpkgopt='path-exclude=/usr/share/zoneinfo/*' bookworm "$base.new.tar" 'deb http://deb.debian.org/debian bookworm main'
	mv "$base.new.tar" "$base"
fi

tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
chmod 755 "$tree"
tar -C "$tree" -xf "$base" --exclude='./dev/*' --exclude='./var/cache/apt/*' --exclude='./var/lib/apt/lists/*'
mknod -m 666 "$tree/dev/null" c 1 3
cp "$deb" "$tree/pmac.deb"

cp -r "$here/inside/system/." "$tree/"
mkdir -p "$tree/guest" "$tree/etc/systemd/system/multi-user.target.wants"
cp "$here/inside/lib.sh" "$here/inside/users.conf" "$tree/guest/"
cp "$here/inside/$part.sh" "$tree/guest/part.sh"
ln -s ../guest.service "$tree/etc/systemd/system/multi-user.target.wants/guest.service"
"$here/modules.sh" "$tree" uio uio_pci_generic
# What a test has no use for and an emulated processor takes seconds for.
for unit in getty.target systemd-timesyncd.service systemd-networkd.service systemd-logind.service systemd-hwdb-update.service \
	systemd-journal-flush.service systemd-update-utmp.service systemd-random-seed.service systemd-firstboot.service \
	e2scrub_reap.service apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer fstrim.timer remote-fs.target; do
	ln -sf /dev/null "$tree/etc/systemd/system/$unit"
done
echo uninitialized >"$tree/etc/machine-id"

rm -f "$image"
truncate -s 300M "$image"
mke2fs -q -t ext4 -O '^has_journal,^metadata_csum' -m 0 -d "$tree" "$image"
