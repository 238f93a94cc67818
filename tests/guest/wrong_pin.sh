#!/bin/sh
# wrong_pin.sh: the ISA guest's test has to fail, and for the right reason, when the board pulses another pin than the driver's.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
name=wrong-pin
if "$here/isa.sh" 5 lines 100 >"$cache/wrong-pin" 2>&1; then
	fail 'interrupts went to pin 5, and the test did not notice'
fi
grep '^isa-5: FAIL interrupts: the board gave [0-9]*, the guest saw 0$' "$cache/wrong-pin" ||
	{ cat "$cache/wrong-pin"; fail 'the test failed for another reason'; }
