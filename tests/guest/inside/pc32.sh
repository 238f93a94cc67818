# The package for processors of 32 bits, on a PC of their time: an ISA board through /dev/mem, its interrupt on IRQ 7.
. /guest/lib.sh
unit=pmacd@pmac0.service
trouble() { fail "$1"; systemctl status --no-pager --lines=30 "$unit"; ls -l /dev/uio* /dev/pmac*; }
position() { pmacctl send '#1P'; }
stands_at() { [ "$(position)" = "$1" ]; }
stands() { before=$(position) && sleep 0.5 && stands_at "$before"; }

say "value processor $(sed -n 's/^model name.*: //p' /proc/cpuinfo), $(uname -m), $(awk '/^MemTotal/ { print int($2 / 1024) }' /proc/meminfo) MiB"
# Nor does every PC with an ISA slot.
expect 'the processor has no SSE2' '' "$(grep -ow sse2 /proc/cpuinfo)"
install_package
mkdir -p "/etc/systemd/system/$unit.d"
cp /usr/share/pmacd/dropins/dev-mem.conf "/etc/systemd/system/$unit.d/"
echo 'board = "mem:0xD4000,irq=uio:/dev/uio0"' >/etc/pmacd/pmac0.toml
systemctl daemon-reload
place_dpram
modprobe pmac_dpram phys=0xd4000 irq=7 ioport=0x210 controller=pmac || fail 'modprobe pmac_dpram'
wait_for 30 systemctl -q is-active "$unit" && ok 'the device starts its service' || trouble 'the device does not start its service'
wait_for 30 pmacctl motors && ok 'servo data' || { trouble 'no servo data'; pmacctl doctor; }

pmacctl send '#1J=2000'
wait_for 20 stands_at 2000 && ok 'a motor goes where it is sent' || trouble "the motor is at $(position), not at 2000"
pmacctl log --seconds 10 --motors 1 --output /run/log.csv >/run/logged 2>&1 || fail "log: $(cat /run/logged)"
say "value log $(tail -n 1 /run/logged)"
say "value memory $(awk '/^VmRSS/ { print $2 }' "/proc/$(systemctl show --value -p MainPID "$unit")/status") KiB the daemon, $(awk '/^MemAvailable/ { print int($2 / 1024) }' /proc/meminfo) MiB left"

pmacctl jog 1 + --hold --seconds 60 >/run/held 2>&1 &
holder=$!
# Nobody asks meanwhile: a program's start may take this processor longer than the lease lasts.
sleep 2
kill -KILL $holder || fail "a hold ends: $(cat /run/held)"
wait_for 10 stands && ok 'it stands when its client is dead' || trouble 'the motor goes on without its client'
[ "$(position | cut -d. -f1)" -gt 3000 ] && ok "and jogged until then, to $(position)" || fail "a held motor does not jog: $(cat /run/held)"
say "value interrupts $(interrupts)"
purge_package
echo '@@ end'
