/* Background variable read: mode and Data-Ready (0x07E8), count (0x07EC), and four longs of the user area that hold the
 * table and, behind its last entry, the values. One table has one entry, the other two; what is data of the first is
 * an entry of the second.
 *
 * Pmac mirrors src/sim/variable_read.rs, but word by word, Host src/function/variable_read.rs. Every access to the DPRAM
 * is one step. A value tells which register it is and which pass read it, in both of its halves.
 *
 * -D...       what changes; what FAILS is told as the counterexample goes
 * PASSES      passes are counted modulo this
 * MULTI       multi-user mode: a ready bit an entry; MULTI=2: the host changes the mode with the table
 * CRASH       the host is killed anywhere, any number of times, and started again
 * NO_SILENCE  the host does not wait, after it has set the count to 0, until a pass under way has ended (50 ms). FAILS: a pass
 *             begun with the old table announces its values when the new one is set up; or it writes its value where the new one
 *             has its second entry by now, which names another register for ever.
 * RESET       the board is reset anywhere while the function runs, once, in single-user mode: it clears the control word,
 *             and perhaps table and values; its timer goes on by one meanwhile (that a new report has the very timer of the old one is
 *             not modelled: 1 in 65536).
 * NO_REREAD   the host does not read timer and control word again at the end of a report. FAILS with RESET: the host has
 *             read the first value; the board is reset and makes another pass; the host reads the second value.
 * TIMER_FIRST the host does, but the timer before the control word. FAILS with RESET: the board is reset before the host reads the
 *             timer for the first time, so that it reads 0, and again 0 at the end; then the next pass ends, and the
 *             control word says ready.
 */
#define READY 128
#define MULTI_USER 2
#ifndef PASSES
#define PASSES 4
#endif
#ifndef MULTI
#define MULTI 0
#endif
#define LONGS 4
byte control;                                         /* bit 0 Data-Ready, bit 1 stands for bit 8, multi-user mode */
byte count, start;
byte y[LONGS], x[LONGS];                              /* the halves of the longs; of an entry: address, kind */

byte pass_number = 0;
bool in_pass = false;
#ifdef RESET
byte timer = 0;                                       /* 0x07EA */
bool running = false, resetting = false;
#endif
bool killed = false;
bool updated = false, taken = false;

proctype Pmac() {
  byte c, n, s, i, value;
  do
  :: {
  do
  :: atomic { c = control; in_pass = true };          /* one background pass */
     atomic { n = count; if :: n == 0 -> goto ended :: else fi };
     atomic { s = start; i = 0; updated = false; if :: !(c & MULTI_USER) && (c & 1) -> goto ended :: else fi };
     do
     :: i < n ->
        if
        :: (c & MULTI_USER) && (x[s + i] & READY) -> goto next
        :: else
        fi;
        atomic { value = (y[s + i] * PASSES + pass_number) & 127 };
        y[s + n + i] = value;
        x[s + n + i] = value;
        if
        :: c & MULTI_USER -> atomic { value = x[s + i] }; x[s + i] = value | READY
        :: else
        fi;
next:   atomic { i++; value = 0 }
     :: else -> break
     od;
     if
     :: c & MULTI_USER
     :: else ->
#ifdef RESET
        timer = 1 + pass_number;
#endif
        c = control; control = c | 1
     fi;
ended: atomic { in_pass = false; pass_number = (pass_number + 1) % PASSES; updated = true; c = 0; n = 0; i = 0; s = 0; value = 0 }
  od
#ifdef RESET
  } unless { atomic { resetting && running ->
    resetting = false; in_pass = false; pass_number = (pass_number + 1) % PASSES; control = 0; timer = 0;
    c = 0; n = 0; i = 0; s = 0; value = 0;
    if
    :: count = 0; start = 0; y[0] = 0; y[1] = 0; y[2] = 0; y[3] = 0; x[0] = 0; x[1] = 0; x[2] = 0; x[3] = 0
    :: skip
    fi } }
#else
  }
#endif
  od
}

#define ADDRESS(i) (2 * table + (i))                  /* the registers of the first table, of the second */

proctype Host() {
  byte n, table, mode, i, word, a, b, p;
  bool is_mixed = false;
#ifdef RESET
  byte stamp;
#endif
  do
  :: {
    count = 0;                                        /* VariableReader::release, at the start */
    control = 0;
    do
    :: atomic { i = 0; if :: table = 1 :: table = 2 fi; n = table;
#if MULTI == 0
         mode = 0
#elif MULTI == 1
         mode = MULTI_USER
#else
         if :: mode = 0 :: mode = MULTI_USER fi
#endif
       };
       count = 0;                                     /* VariableReader::begin */
#ifndef NO_SILENCE
       !in_pass;                                      /* SETTLE */
#endif
       start = 0;
       do
       :: i < n -> y[start + i] = ADDRESS(i); atomic { x[start + i] = 0; i++ }
       :: else -> break
       od;
       control = mode;
       atomic { count = n; i = 0;
#ifdef RESET
         running = true
#endif
       };
       do                                             /* VariableReader::look */
       ::
#ifdef RESET
          atomic { running = false; break }
#else
          break                                       /* another table is wanted */
#endif
       :: atomic { word = control; taken = false };
          if
          :: (word & MULTI_USER) != mode || (mode && (word & 1)) -> control = mode
          :: else -> if
             :: mode -> i = 0;
                do
                :: i < n ->
                   word = x[start + i];
                   if
                   :: !(word & READY) -> goto unready
                   :: word == READY ->
                      a = y[start + n + i];
                      atomic { b = x[start + n + i]; assert(a == b && a / PASSES == ADDRESS(i)); a = 0; b = 0; taken = true }
                   :: else
                   fi;
                   x[start + i] = 0;
unready:           i++
                :: else -> break
                od
             :: !mode && !(word & 1)
             :: !mode && (word & 1) -> i = 0;
#ifdef RESET
                stamp = timer;
#endif
                do
                :: i < n ->
                   a = y[n + i];
                   atomic {
                     b = x[n + i];
                     if
                     :: a == b && a / PASSES == ADDRESS(i) && (i == 0 || a % PASSES == p) -> skip
                     :: else -> is_mixed = true
                     fi;
                     p = a % PASSES; a = 0; b = 0; i++
                   }
                :: else -> break
                od;
#if defined(RESET) && !defined(NO_REREAD)
#ifdef TIMER_FIRST
                if :: timer != stamp -> goto gone :: else fi;
                if :: (control & 3) != 1 -> goto gone :: else fi;
#else
                if :: (control & 3) != 1 -> goto gone :: else fi;
                if :: timer != stamp -> goto gone :: else fi;
#endif
#endif
                assert(!is_mixed);
                atomic { control = mode; p = 0; taken = true };
gone:           atomic { is_mixed = false; p = 0
#ifdef RESET
                  ; stamp = 0
#endif
                }
             fi
          fi;
          atomic { i = 0; word = 0 }
       od;
    od
  } unless { atomic { killed -> killed = false; i = 0; word = 0; a = 0; b = 0; p = 0; n = 0; table = 0; mode = 0; is_mixed = false
#ifdef RESET
    ; stamp = 0; running = false
#endif
  } }
  od
}

proctype Chaos() {
#ifdef RESET
  resetting = true;
#endif
#ifdef CRASH
  do
  :: killed = true; !killed
  :: break
  od;
#endif
  skip
}

init { atomic { run Pmac(); run Host(); run Chaos() } }
