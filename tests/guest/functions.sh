#!/bin/sh
# functions.sh DIR PMACCTL [OPTION...]: every automatic function of the DPRAM once, through a running daemon.
# What it prints is the same wherever the daemon runs, so a real window and a memory file can be compared line by line.
# It works in DIR. Runs in busybox as well.
cd "$1" || exit
shift

# Several words, so that --socket can be among them.
pmacctl="$*"
say() { printf -- '-- %s\n' "$*"; }
run() { say "$*"; $pmacctl "$@" 2>&1; echo "exit $?"; }

# Asks until the answer is the one expected, or 20 s have gone by.
until_reply() { # REPLY LINE
	i=0
	while got=$($pmacctl send "$2" 2>&1); [ "$got" != "$1" ]; do
		i=$((i + 1))
		[ $i -lt 200 ] || { echo "\"$2\" answers \"$got\", expected \"$1\""; return 1; }
		sleep 0.1
	done
	echo "\"$2\" answers \"$1\""
}

# Actual positions, from the servo report, not from a question.
position() { $pmacctl motors | awk -v motor="#$1" '$1 == motor { print $4 }'; }

say 'the board as it was saved, its servo report begun, its motors closed'
# A daemon that has just started sends nobody's line before the board has answered its own.
i=0
until $pmacctl send I59 >/dev/null 2>&1 || [ $i -gt 100 ]; do
	i=$((i + 1))
	sleep 0.1
done
# A board that resets answers nobody.
$pmacctl send --timeout 0.3 '$$$' >reset 2>&1
until_reply 8 I59
$pmacctl send '#1J/ #2J/ #3J/ #4J/ #5J/ #6J/ #7J/ #8J/ GATHER' 2>&1
i=0
until $pmacctl motors >/dev/null 2>&1 || [ $i -gt 100 ]; do
	i=$((i + 1))
	sleep 0.1
done

say 'command lines'
run send 'I122 I19'
run send XYZZY
run send 'P1=17'
run send P1

say 'servo data: a motor that moves'
run send '#2J=-60000'
first=$(position 2)
sleep 0.5
second=$(position 2)
[ "$first" != "$second" ] && echo 'the position changes' || echo "the position stays at $first"
$pmacctl motors --json | grep -q '"fresh": *true' && echo 'the data are fresh' || echo 'the data are stale'
run send '#2J/'
run send '#2J=0'
run send '#1J=3000'
until_reply 3000 '#1P'
until_reply 0 '#2P'
sleep 0.3
run motors

say 'background data'
run coordinates

say 'control panel'
run panel jog+ 3
sleep 0.3
run panel jog-stop 3
sleep 0.5
[ "$(position 3)" != 0 ] && echo 'the motor has jogged' || echo 'the motor has not moved'
run panel feed 1 50%
run panel show
run panel feed 1 off
run send '#3J=0'
until_reply 0 '#3P'

say 'background variables'
run variable set Y:\$0770,8,4=5 X:\$0771=-2 D:\$0778=1000000
run variable watch --count 1 Y:\$0770,u X:\$0771 D:\$0778 1.actual_position | sed 's/^servo=[0-9]*/servo=N/'
run variable list

say 'gather'
if $pmacctl gather --source 1.actual_position --period 10 --seconds 0.5 -o gathered.csv >"summary" 2>&1; then
	sed 's/samples=[0-9]*/samples=N/; s/seconds=.*/seconds=S/' summary
	sed 's/^[0-9]*,[0-9.]*,/N,T,/' gathered.csv | sort -u
	[ "$(wc -l <gathered.csv)" -gt 20 ] && echo 'as many as there should be' || echo 'too few'
else
	cat summary
fi

say 'a binary rotary program: ten moves, and settings enough that the buffer goes round'
{
	i=0
	while [ $i -lt 200 ]; do
		echo "P3=$i"
		[ $((i % 20)) != 0 ] || echo "X$((i * 10)) Y$((i * 5))"
		i=$((i + 1))
	done
	echo 'P2=42'
} >program.pmc
run send '&1 #1->X #2->Y'
run rotary stream program.pmc --define 1000 --run | sed 's/underruns=.*/underruns=N/'
until_reply 42 P2
until_reply 199 P3
until_reply 1800 '#1P'
until_reply 900 '#2P'
run send '&1A'
sleep 0.5
run coordinates | sed 's/^\( *&[12] .* 0 \) *[0-9.]*/\1T/'

say 'open words'
run write 'Y:$D800' -5
run write 'Y:$D800,8,4' 3
run read 'Y:$D800' 'Y:$D800,8,4'
run write 'X:$D009' 1
run send '^K'
