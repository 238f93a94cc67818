#!/bin/sh
# modules.sh TREE MODULE...: the kernel's modules of those names with what they need, and our own, where TREE's modprobe finds them.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
tree=$1
shift
version=$(cat "$kernel/version")
modules=$tree/lib/modules/$version
mkdir -p "$modules"
for module in "$@"; do
	modprobe --set-version "$version" --dirname "$kernel/root" --show-depends "$module"
done | sed -n 's/^insmod \([^ ]*\).*/\1/p' | while read -r file; do
	case $file in
	*.xz) xz -dc "$file" >"$modules/$(basename "$file" .xz)" ;;
	*) cp "$file" "$modules/" ;;
	esac
done
cp "$kernel"/modules/modules.order "$kernel"/modules/modules.builtin* "$modules/"
for module in "$kernel"/module/*.ko "$kernel"/vme/*.ko "$kernel"/vme/core/*.ko; do
	[ ! -e "$module" ] || cp "$module" "$modules/"
done
depmod -b "$tree" "$version"
