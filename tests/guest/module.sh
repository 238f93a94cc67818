#!/bin/sh
# module.sh KERNEL: builds kernel/ for that kernel (see kernel.sh) in KERNEL/module, with every warning the kernel's own builds know, none of which may appear.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
headers=$1/headers
dir=$1/module
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
grep -qx "PACKAGE_VERSION=\"$version\"" "$here/../../kernel/dkms.conf" && grep -q "PMAC_VERSION.*\"$version\"" "$here/../../kernel/pmac_dpram.c" ||
	{ echo "module.sh: kernel/dkms.conf and kernel/pmac_dpram.c are not of version $version" >&2; exit 1; }
rm -rf "$dir"
mkdir -p "$dir"
cp -r "$here"/../../kernel/. "$dir"
# A module's type information would need pahole, which is not there.
if ! make -C "$dir" KDIR="$headers" W=1 CONFIG_DEBUG_INFO_BTF_MODULES= modules >"$dir/log" 2>&1 || grep -q 'warning:' "$dir/log"; then
	cat "$dir/log"
	echo 'module.sh: kernel/ does not build without warnings' >&2
	exit 1
fi
strip --strip-debug "$dir/pmac_dpram.ko"
