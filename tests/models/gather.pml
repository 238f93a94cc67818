/* Gathering round and round (I45=3): a ring of CAP samples of two words, an index, and a clock that counts servo cycles. The host
 * numbers samples by index and clock, and tells how many were overwritten before it came.
 *
 * Pmac mirrors src/sim/board/gather.rs, Host src/function/gather.rs. Every access to the DPRAM is one step; how long the host
 * stands still between two of its own, nobody knows. A value is its sample's number, in both of its words.
 *
 * -D...        what changes; what FAILS is told as the counterexample goes
 * LATE         the clock counts a cycle after its sample was stored, not before
 * NO_AGAIN     the index is not read again after a copy. FAILS: the board stores a turn of samples during the copy.
 * KEEP_ALL     a full turn counts as there, with the sample that the board stores next. FAILS: it is stored while it is copied.
 * NO_CLOCK     samples are numbered by the index alone. FAILS: the host sleeps for a turn, and takes a sample for an older one.
 * NO_BRACKET   an index counts however long the host stood still between the clock's readings around it. FAILS: two numbers of
 *              samples a turn apart fit it.
 */
#define CAP 6
#define CHUNK 2
#define SLACK 1
#ifndef SAMPLES
#define SAMPLES 12
#endif
#define NOTHING 255

byte low[CAP], high[CAP];
byte index = 0;
byte clock = 0;

proctype Pmac() {
  byte n = 0, slot = 0;
  do
  :: n < SAMPLES ->
#ifndef LATE
     clock++;
#endif
     low[slot] = n;
     high[slot] = n;
     index = (slot + 1) % CAP;
     atomic {
#ifdef LATE
       clock++;
#endif
       n++; slot = (slot + 1) % CAP
     }
  :: else -> break
  od
}

byte written = 0, read = 0, lost = 0;
byte last_before = 0, last_after = 0;

/* GatherReader::learn: how many samples there are, now that the index is `at`, read between the clock's `from` and `to`. */
inline learn(at, from, to) {
  d_step {
    learned = true;
    ahead = (at + CAP - written % CAP) % CAP;
#ifdef NO_CLOCK
    written = written + ahead;
#else
    most = to - last_before + SLACK;
    if
#ifndef NO_BRACKET
    :: to - from > CAP / 4 -> learned = false
#endif
    :: else ->
       if
       :: ahead > most -> learned = false             /* the clock has paused: it is waited for */
       :: else ->
          written = written + ahead + ((most - ahead) / CAP) * CAP;
          last_before = from;
          last_after = to
       fi
    fi;
#endif
#ifdef KEEP_ALL
    oldest = (written > CAP -> written - CAP : 0);
#else
    oldest = (written > CAP - 1 -> written - (CAP - 1) : 0);
#endif
    if
    :: learned && read < oldest -> lost = lost + (oldest - read); read = oldest
    :: else
    fi;
    ahead = 0; most = 0; oldest = 0
  }
}

proctype Host() {
  byte before, after, at, count, first, i;
  byte ahead, most, oldest;
  byte a[CHUNK], b[CHUNK];
  bool learned;
  do
  :: before = clock;
     at = index;
     after = clock;
     learn(at, before, after);
     if :: !learned -> goto ended :: else fi;
     atomic {
       count = (written > read -> written - read : 0);
       if :: count > CHUNK -> count = CHUNK :: else fi;
       first = read; i = 0
     };
     if :: count == 0 -> goto ended :: else fi;
     do
     :: i < count -> a[i] = low[(first + i) % CAP]; b[i] = high[(first + i) % CAP]; i++
     :: else -> break
     od;
#ifndef NO_AGAIN
     at = index;
     before = after;
     after = clock;
     learn(at, before, after);
     if :: !learned -> goto ended :: else fi;
#endif
     skip;
     d_step {
       i = 0;
       do
       :: i < count ->
          if
          :: first + i >= read -> assert(a[i] == first + i && b[i] == first + i); read = first + i + 1
          :: else
          fi;
          i++
       :: else -> break
       od;
       assert(read <= written && lost <= read)
     };
ended: atomic { a[0] = 0; a[1] = 0; b[0] = 0; b[1] = 0; before = 0; after = 0; at = 0; count = 0; first = 0; i = 0 }
  od
}

init {
  byte i = 0;
  atomic {
    do
    :: i < CAP -> low[i] = NOTHING; high[i] = NOTHING; i++
    :: else -> break
    od;
    run Pmac(); run Host()
  }
}
