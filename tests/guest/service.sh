#!/bin/sh
# service.sh: the package on a Debian with systemd and udev, in a guest.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
open_site service
simulator
# shellcheck disable=SC2046 # words
boot system 2 'systemd.show_status=0' $(host_port) \
	-drive "if=none,id=disk,file=$cache/system.ext4,format=raw,snapshot=on" -device virtio-blk-pci,drive=disk
bridge_edge 7
guest_verdict
[ "$(value interrupts)" -gt 0 ] || fail 'no interrupt came'
echo "$name: ok $(value interrupts) interrupts since the device came back"
