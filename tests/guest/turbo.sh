#!/bin/sh
# turbo.sh: a Turbo PMAC2 with 64 KiB of DPRAM, as a PCI board and in the ISA hole through /dev/mem. It is known by its report.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"

open_site turbo
dpram=64K
simulator --family turbo2 --dpram 32k
boot turbo 1 ''
guest_verdict
