#!/bin/sh
# vme_module.sh KERNEL: builds kernel/vme for that kernel (see kernel.sh) in KERNEL/vme as a Debian user does, with the VME bus out of the
# kernel's own source, and without a warning; and the kernel's vme_fake with our simulated card (see vme_machine.c).
# APT may hold options for apt, as for kernel.sh.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
vme=$here/../../kernel/vme
dir=$1/vme
core=$1/vme-core
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
grep -qx "PACKAGE_VERSION=\"$version\"" "$vme/dkms.conf" && grep -q "PMAC_VERSION.*\"$version\"" "$vme/pmac_vme.c" ||
	{ echo "vme_module.sh: kernel/vme/dkms.conf and kernel/vme/pmac_vme.c are not of version $version" >&2; exit 1; }

if [ ! -f "$core/vme.h" ]; then
	package=linux-source-$(cut -d . -f 1,2 "$1/version")
	rm -rf "$core" "$1/vme-source"
	mkdir -p "$1/vme-source"
	# shellcheck disable=SC2086
	(cd "$1/vme-source" && apt-get ${APT-} -o APT::Sandbox::User=root download -qq "$package")
	dpkg-deb --fsys-tarfile "$1/vme-source/"*.deb | tar -x -C "$1/vme-source" "./usr/src/$package.tar.xz"
	sh "$vme/vme-core" "$1/vme-source/usr/src/$package.tar.xz" "$core"
	rm -r "$1/vme-source"
fi

rm -rf "$dir"
cp -r "$vme" "$dir"
cp -r "$core" "$dir/core"
cp "$here/vme_machine.c" "$dir/core/"
sed -i 's/= fake_master_set;/= machine_master_set;/; s/^static int __init fake_init/#include "vme_machine.c"\n\n&/
	s/exit_pointer = fake_bridge;/&\n\treturn machine_begin();/; s/fake_bridge = exit_pointer;/&\n\tmachine_end();/' "$dir/core/vme_fake.c"
echo 'obj-m += core/vme_fake.o' >>"$dir/Kbuild"
if ! make -C "$dir" KDIR="$1/headers" W=1 CONFIG_DEBUG_INFO_BTF_MODULES= modules >"$dir/log" 2>&1 || grep -q 'pmac_.*warning:' "$dir/log"; then
	cat "$dir/log"
	echo 'vme_module.sh: kernel/vme does not build without warnings' >&2
	exit 1
fi
strip --strip-debug "$dir"/*.ko "$dir"/core/*.ko
