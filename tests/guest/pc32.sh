#!/bin/sh
# pc32.sh: the package for i386 on a Debian of 32 bits, on a PC as an ISA board may sit in: a Pentium III, 128 MiB, an ISA board. The slowest
# processor that Debian for i386 takes has no SSE2 either.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
KERNEL=kernel-686
PC='qemu-system-i386 -cpu pentium3 -m 128'
. "$here/common.sh"
open_site pc32
simulator
# shellcheck disable=SC2046 # words
boot system 1 'systemd.show_status=0' $(host_port) \
	-drive "if=none,id=disk,file=$cache/system-i386.ext4,format=raw,snapshot=on" -device virtio-blk-pci,drive=disk
bridge_edge 7
guest_verdict
[ "$(value interrupts)" -gt 0 ] || fail 'no interrupt came'
for what in processor memory log interrupts; do echo "$name: $what: $(value $what)"; done
