/* Binary rotary buffer: a ring of four commands (eight longs), the indexes at header words Y+1 and X+1, I57.
 *
 * Pmac mirrors src/sim/rotary_transfer.rs, Host src/function/rotary.rs (`offer`, `set_up`). Every access to the DPRAM is
 * one step, but that a command's long is written and read as a whole. PMAC here does not trust the host's index to tell
 * where a line ends: it reads on until the next start of a line, so the end marker is on trial too.
 *
 * What holds: PMAC takes every line whole, once, in order, and nothing else; with room they go on for ever.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * CRASH       the host is killed anywhere, any number of times (LIVE: once), and started again; I57=0 before it sets up
 * RESET       the board is reset anywhere, any number of times (LIVE: once): I57=0; what was in its ring is lost, and told
 * INDEX_FIRST the host's index moves before the commands are written. FAILS: PMAC takes what lay there before.
 * NO_MARKER   no end marker is written. FAILS: PMAC, at the end of a line, reads on into commands of an old one.
 * MARKER_LAST the end marker is written behind the line after the index moved. FAILS: the same, seldom.
 * FILL        the ring is filled to the last command instead of leaving two free. FAILS: the end marker overwrites a
 *             command that PMAC has not taken yet.
 * I57_STAYS   the new host sets up without I57=0. FAILS with CRASH: PMAC, about to take a line, finds there the marker
 *             of an empty ring.
 * TURBO       a Turbo board. There i57 stands for binary entry, which OPEN BINARY ROTARY opens and CLOSE closes. A new host finds
 *             a dead one's still open, and sends nothing until somebody has closed it, as somebody may at any time; who streams
 *             is told. With I57_STAYS it sets up all the same. FAILS with CRASH, as above.
 */
#define SIZE 4
#define MARKER 128                                    /* start of line, no command */
#define START 64
#define LINES 8
#ifdef FILL
#define FREE 0
#else
#define FREE 2
#endif

byte ring[SIZE];
byte host_index = 0, pmac_index = 0;
bool i57 = false;

byte line = 0;                                        /* the host's last complete line, modulo LINES */
byte expected = 1;                                    /* the line that PMAC has to take next */
bool in_pass = false;
bool killed = false, resetting = false, lost = false;
bool took = false;

#define COMMAND(l, k) ((l) * 2 + (k) + ((k) == 0 -> START : 0))
#define LENGTH(l) (1 + (l) % 2)                       /* lines of one command and of two */

proctype Pmac() {
  byte at, end, command, whose, n;
  do
  :: {
    do
    :: atomic { i57 -> in_pass = true };              /* one background pass: one line */
       end = host_index;
       at = pmac_index;
       atomic { took = false; if :: at == end -> goto ended :: else fi };
       atomic { command = ring[at]; assert(command >= START && command < MARKER); whose = (command - START) / 2; n = 1 };
       at = (at + 1) % SIZE;
       do
       :: atomic {
            command = ring[at];
            if
            :: command >= START -> break              /* the next line, or the end marker */
            :: else -> assert(command == COMMAND(whose, n)); n++; at = (at + 1) % SIZE
            fi
          }
       od;
       atomic { assert(n == LENGTH(whose) && whose == expected); expected = (expected + 1) % LINES; took = true };
       pmac_index = at;
ended: atomic { in_pass = false; at = 0; end = 0; command = 0; whose = 0; n = 0 }
    od
  } unless { atomic { resetting -> resetting = false; i57 = false; in_pass = false; lost = true;
                      at = 0; end = 0; command = 0; whose = 0; n = 0 } }
  od
}

inline put(index, value) { ring[(index) % SIZE] = value }

proctype Host() {
  byte at, ahead, next;
  do
  :: {
#if defined(TURBO) && !defined(I57_STAYS)
    atomic { !i57 && !in_pass };                      /* every line is refused until then */
#elif !defined(I57_STAYS)
    atomic { i57 = false; !in_pass };                 /* I57=0, by a command line; acknowledged between two passes */
#endif
    put(0, MARKER);                                   /* set_up */
    pmac_index = 0;
    host_index = 0;
    atomic { at = 0; expected = (line + 1) % LINES; lost = false };
    i57 = true;                                       /* I57=1 */
    do
    :: lost -> break                                  /* told; somebody sets up again */
    :: atomic { true -> next = (line + 1) % LINES };
       do
       :: atomic {
            ahead = (at + SIZE - pmac_index) % SIZE;
            if
            :: ahead + LENGTH(next) <= SIZE - FREE -> break
            :: else -> if :: lost -> goto reset :: else fi
            fi
          }
       od;
#ifdef INDEX_FIRST
       host_index = (at + LENGTH(next)) % SIZE;
#endif
#if !defined(NO_MARKER) && !defined(MARKER_LAST)
       put(at + LENGTH(next), MARKER);
#endif
       if
       :: LENGTH(next) == 2 -> put(at + 1, COMMAND(next, 1))
       :: else
       fi;
       put(at, COMMAND(next, 0));
#ifndef INDEX_FIRST
       atomic { host_index = (at + LENGTH(next)) % SIZE; line = next };
#else
       atomic { line = next };
#endif
#ifdef MARKER_LAST
       put(at + LENGTH(next), MARKER);
#endif
       at = (at + LENGTH(next)) % SIZE
    od;
reset: skip
  } unless { atomic { killed -> killed = false; at = 0; ahead = 0; next = 0 } }
  od
}

/* Another client, or another host. */
proctype Closes() {
  do
  :: atomic { i57 && !in_pass -> i57 = false; lost = true }
  od
}

proctype Chaos() {
#ifdef CRASH
  do
  :: killed = true; !killed
#ifdef LIVE
     ; break
#endif
  :: break
  od;
#endif
#ifdef RESET
  do
  :: resetting = true; !resetting
#ifdef LIVE
     ; break
#endif
  :: break
  od;
#endif
  skip
}

ltl lines_go_on { [] <> took }

init {
  atomic {
    run Pmac(); run Host(); run Chaos();
#ifdef TURBO
    run Closes()
#endif
  }
}
