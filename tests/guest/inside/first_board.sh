# docs/first-board.md, typed as it stands, at a board that was just switched on: nothing of its DPRAM is enabled, its drives are off.
# The page's blocks say by their kind what happens to them:
#   toml guest [pmac|turbo]      it is first.toml
#   text serial [pmac|turbo]     what stands behind "> " is typed at the serial line; below it stands the answer
#   console guest [pmac|turbo]   what stands behind "$ " is typed; below it stands what is printed: numbers may differ, … is anything
#   … exact                      numbers may not
# What begins with pmacd is left running until the next of these, or the end.
model=$(argument board)
case $model in
pmac) place_dpram && place=mem:0xD4000 ;;
turbo) memory=$(pci_device 0x1af4 0x1110) && place=pci:${memory##*/},bar=2,length=0x10000 ;;
esac

# The package makes the user.
echo 'pmacd:x:900:900::/:/bin/sh' >>/etc/passwd
printf 'pmacd:x:900:\npmac:x:901:pmacd\n' >>/etc/group
mkdir -p /run/first && cd /run/first || exit

# A user's board has its own name and serial line.
here() { sed "s/pci:0000:03:00.0/$place/; s#/dev/ttyS0#/dev/ttyS1#"; }

# What is left of a text when its numbers may differ, and with them the width of its columns.
shape() { sed 's/[0-9][0-9.]*/0/g; s/ -0/ 0/g; s/=-0/=0/g; s/   */ /g; s/  */ /g; s/^ //; s/ *$//'; }
columns() { sed 's/  */ /g; s/^ //; s/ *$//'; }

# matches EXPECTED GOT FORM: after FORM, with … for anything, and for any lines where it stands alone.
matches() {
	pattern=$(echo "$1" | $3 | sed 's/[][*?\\]/\\&/g; s/…/*/g' | awk '$0 == "*" { printf "*"; next } { printf "\n%s", $0 }')
	text=$(echo "$2" | $3 | awk '{ printf "\n%s", $0 }')
	case $text in
	$pattern) ;;
	*) return 1 ;;
	esac
}

# Turns the shaft of motor 1 by 500 counts, by the control socket of the simulated board.
turn() {
	for time in 1 2 3 4 5; do
		sleep 1
		echo 'turn 1 100' >/dev/vport0p1
	done
}

# Seconds that what is printed may take to become what the page shows, on a machine that does other things beside.
PATIENCE=30

leave() {
	[ -n "${daemon-}" ] || return
	kill "$daemon"
	wait "$daemon"
	expect 'pmacd ends when told to' 0 $?
	daemon=
}

# begin LINE: types it, as a user would, at the serial line or in one or the other terminal. What it prints comes into the file typed, that of pmacd into log.
begin() {
	: >typed
	case $kind:$1 in
	serial:*)
		cat <&3 >typed &
		listener=$!
		printf '%s\r' "$1" >&3
		;;
	console:pmacd\ *)
		leave
		sh -c "exec $1" >log 2>&1 &
		daemon=$!
		;;
	console:*watch*--seconds*)
		turn &
		sh -c "$1" >typed 2>&1
		wait $!
		;;
	*) sh -c "$1" >typed 2>&1 ;;
	esac
}

# What LINE has printed by now. Of an answer at the serial line, the lines stand between LF and CR; checksums and <ACK> do not.
printed() {
	case $kind:$1 in
	serial:*) tr '\n\r' '\r\n' <typed | sed '$d; s/.*\r//' ;;
	console:pmacd\ *) cat log ;;
	# These only look: a user looks again.
	console:'pmacctl doctor' | console:'pmacctl motors') sh -c "$1" 2>&1 ;;
	*) cat typed ;;
	esac
}

# is_over LINE: nothing more will come.
is_over() {
	case $kind:$1 in
	serial:* | console:pmacd\ * | console:'pmacctl doctor' | console:'pmacctl motors') [ "$(cut -d. -f1 /proc/uptime)" -ge $deadline ] ;;
	esac
}

# The command collected so far is typed, and what it prints compared.
command=
finish() {
	[ -n "$command" ] || return
	deadline=$(($(cut -d. -f1 /proc/uptime) + PATIENCE))
	begin "$command"
	until got=$(printed "$command"); matches "$expected" "$got" "$form" || is_over "$command"; do sleep 0.2; done
	[ -z "${listener-}" ] || { kill $listener && wait $listener; listener=; }
	echo "$got" | sed "s,^,| ,"
	if matches "$expected" "$got" "$form"; then
		ok "$command"
	else
		fail "$command"
		echo "-- the page has:" && echo "$expected"
		echo "-- printed was:" && echo "$got"
	fi
	command=
}

modprobe -a virtio_pci virtio_console
stty -F /dev/ttyS1 9600 raw -echo
exec 3<>/dev/ttyS1
kind=
while IFS= read -r line <&4; do
	case $line in
	'```'*)
		finish
		case $line in *' exact') form=columns ;; *) form=shape ;; esac
		case ${line% exact} in
		'```console guest' | "\`\`\`console guest $model") kind=console ;;
		'```text serial' | "\`\`\`text serial $model") kind=serial ;;
		'```toml guest' | "\`\`\`toml guest $model") kind=toml && : >first.toml ;;
		*) kind= ;;
		esac
		;;
	*)
		case $kind$line in
		'') ;;
		toml*) echo "$line" | here >>first.toml ;;
		console\$\ * | serial\>\ *)
			finish
			command=$(echo "${line#??}" | here)
			expected=
			;;
		console* | serial*) expected=${expected:+$expected
}$(echo "$line" | here) ;;
		esac
		;;
	esac
done 4</guest/first-board.md
leave
