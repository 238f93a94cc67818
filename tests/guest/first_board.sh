#!/bin/sh
# first_board.sh pmac|turbo: docs/first-board.md at a board that was just switched on: a PMAC as an ISA board, a Turbo PMAC2 as a PCI board.
# Its serial line is the guest's second one. The hand that turns its motors is a port to the simulator's control socket.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
board=$1

open_site "first-board-$board"
cat >"$site/machine" <<'END'
I100=1 I200=1 I300=1 I400=1
SAVE
END
case $board in
pmac) set -- --family pmac ;;
turbo) set -- --family turbo2 --dpram 32k && dpram=64K ;;
esac
background simulator "$programs/pmac-sim" --memory "$site/dpram" --servo-hz 1100 --startup "$site/machine" \
	--serial "unix:$site/serial" --control "unix:$site/control" "$@"
wait_for 10 'the simulator' test -S "$site/control"
boot first_board 1 "pmac.board=$board" -serial "unix:$site/serial" \
	-chardev "socket,id=hand,path=$site/control" -device virtio-serial-pci -device virtserialport,chardev=hand
guest_verdict
