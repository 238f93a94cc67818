#!/bin/sh
# system_image.sh DEB IMAGE: a disk with a minimal Debian (systemd, udev, no D-Bus), our package installed by dpkg, users of all roles.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
deb=$1
image=$2

base=$cache/debian.tar
if [ ! -f "$base" ]; then
	mmdebstrap --quiet --mode=root --variant=essential --include=systemd-sysv,udev,kmod --aptopt='APT::Install-Recommends "false"' \
		--dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' --dpkgopt='path-exclude=/usr/share/locale/*' \
		--dpkgopt='path-exclude=/usr/share/zoneinfo/*' bookworm "$base.new.tar"
	mv "$base.new.tar" "$base"
fi

tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
chmod 755 "$tree"
tar -C "$tree" -xf "$base" --exclude='./dev/*' --exclude='./var/cache/apt/*' --exclude='./var/lib/apt/lists/*'
mknod -m 666 "$tree/dev/null" c 1 3
cp "$deb" "$tree/pmac.deb"
# As anybody would install it; the version of Debian is that of the machine the package was built on.
chroot "$tree" dpkg --install /pmac.deb >"$cache/dpkg.log" 2>&1 || { cat "$cache/dpkg.log" >&2; exit 1; }
rm "$tree/pmac.deb"

cp -r "$here/inside/system/." "$tree/"
mkdir -p "$tree/guest" "$tree/etc/systemd/system/pmacd@pmac0.service.d" "$tree/etc/systemd/system/multi-user.target.wants"
cp "$here/inside/lib.sh" "$here/inside/service.sh" "$tree/guest/"
cp "$tree/usr/share/pmacd/dropins/device.conf" "$tree/etc/systemd/system/pmacd@pmac0.service.d/"
ln -s ../guest.service "$tree/etc/systemd/system/multi-user.target.wants/guest.service"
chroot "$tree" systemd-sysusers guest.conf 2>"$cache/sysusers.log"
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
