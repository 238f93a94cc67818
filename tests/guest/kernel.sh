#!/bin/sh
# kernel.sh DIR: Debian's current kernel for virtual machines and its headers, unpacked under DIR, nothing installed.
#   DIR/vmlinuz  DIR/modules/ (the tree depmod made)  DIR/headers (what KDIR= wants)  DIR/version
# APT may hold options for apt, such as those of another release's package lists, ALSO further packages whose files go to DIR/root.
set -eu
dir=$1
apt_options=${APT-}
flavour=${FLAVOUR-cloud-amd64}
mkdir -p "$dir"
dir=$(cd "$dir" && pwd)

depends() { # PACKAGE PATTERN: the dependency of PACKAGE whose name begins so
	# shellcheck disable=SC2086
	apt-cache $apt_options depends "$1" 2>/dev/null | sed -n "s/^ *Depends: \($2[^ ]*\)\$/\1/p" | head -n 1
}

# Superseded versions vanish from the mirror, so the name comes from the package that always depends on the newest.
image=$(depends "linux-image-$flavour" 'linux-image-[0-9]')
[ -n "$image" ] || { echo "kernel.sh: no linux-image-$flavour in the package lists; apt-get update" >&2; exit 1; }
version=${image#linux-image-}
[ "$(cat "$dir/version" 2>/dev/null)" != "$version" ] || exit 0
headers=linux-headers-$version
common=$(depends "$headers" 'linux-headers-.*-common')
kbuild=$(depends "$headers" 'linux-kbuild-')

rm -rf "$dir"
mkdir -p "$dir/deb" "$dir/root"
# The directory may be nobody else's to read, so apt stays who it is. The kernel's postinst would build an initramfs and touch the boot loader; only its files are wanted.
# shellcheck disable=SC2086
(cd "$dir/deb" && apt-get $apt_options -o APT::Sandbox::User=root download -qq "$image" "$headers" "$common" "$kbuild" ${ALSO-})
for package in "$dir"/deb/*.deb; do
	dpkg-deb --extract "$package" "$dir/root"
done
rm -r "$dir/deb"

# The headers name each other by absolute path, as if installed.
source=$dir/root/usr/src
for file in "$source/$headers/Makefile" "$source/$headers/.kernelvariables" "$source/$common/Makefile"; do
	[ ! -f "$file" ] || sed -i "s#/usr/src/linux-headers#$source/linux-headers#g; s#/usr/lib/linux-kbuild#$dir/root/usr/lib/linux-kbuild#g" "$file"
done
for tree in "$source/$headers" "$source/$common"; do
	for link in scripts tools; do
		[ ! -L "$tree/$link" ] || ln -sfn "$dir/root/usr/lib/$kbuild/$link" "$tree/$link"
	done
done
ln -sfn "root/usr/src/$headers" "$dir/headers"
ln -sfn "root/boot/vmlinuz-$version" "$dir/vmlinuz"
# depmod looks for lib/modules; Debian 13 has it below usr.
modules=$dir/root/lib/modules/$version
[ -d "$modules" ] || modules=$dir/root/usr/lib/modules/$version
ln -sfn "$modules" "$dir/modules"
depmod -b "${modules%/lib/modules/*}" "$version"
echo "$version" >"$dir/version"
