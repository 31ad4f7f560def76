#!/usr/bin/env bash
# Counts wordings that comments, documents, help and messages avoid. Exits 1 if the sum exceeds the limit, which only ever falls.
#   tics.sh [PATHSPEC...]            hits per label and their sum (default: all tracked text)
#   tics.sh -l LABEL [PATHSPEC...]   the lines of one label, and what to write instead
# A line counts once per label. Exceptions: the second pattern of a label; history in the changelog; this file; data:
EXCEPT=(':!*.lock' ':!*.csv' ':!*.svg' ':!*.json' ':!*.mcap' ':!*.msh' ':!*.vtu' ':!*.hex' ':!*.frd' ':!*.cdb' ':!*.xdmf'
    ':!*.xplt' ':!*.pack' ':!*.ipynb' ':!*/tests/data/*' ':!fuzz/corpus' ':!scripts/checks/tics.sh')
LIMIT=16
set -uo pipefail
only=
if [ "${1:-}" = -l ]; then only=${2:?label}; shift 2; fi
paths=("$@")
[ $# -gt 0 ] || cd "$(dirname "${BASH_SOURCE[0]}")/../.." || exit 2
sum=0

# tic LABEL INSTEAD PATTERN [EXCEPTION]: extended regular expressions; Tic: with case.
tic() { count -i "$@"; }
Tic() { count -I "$@"; }
count() {
    local case=$1 label=$2 instead=$3 pattern=(-e "$4") hits number=0
    [ -z "$only" ] || [ "$only" = "$label" ] || return
    [ -z "${5:-}" ] || pattern+=(--and --not -e "$5")
    hits=$(git grep -nIE "$case" "${pattern[@]}" -- "${paths[@]}" "${EXCEPT[@]}" ${history:-})
    if [ $? -gt 1 ]; then exit 2; fi
    [ -z "$hits" ] || number=$(wc -l <<<"$hits")
    sum=$((sum + number))
    if [ -n "$only" ]; then
        [ -z "$hits" ] || echo "$hits"
        echo "instead: $instead"
    elif ((number > 0)); then
        printf '%6d  %s\n' "$number" "$label"
    fi
}

# Openings of comments, sentences without a subject.
Tic what-opener 'noun phrase (type, field), third-person verb (function)' '^[[:space:]]*(//[/!]|\*|""")[[:space:]]?What( |$)'
Tic of-by-opener 'the whole noun phrase' '^[[:space:]]*(//[/!]|""")[[:space:]]?(Of|By) '
Tic dots-opener 'one complete comment per item' '^[[:space:]]*///? \.\.\.'
Tic verb-first 'subject first' '(^|[^a-z] )(Read|Refused|Kept|Chosen|Minimised|Added|Measured|Not there|Needed) (too )?(are|is|here is)\b'
tic that-is-wrong 'all errors in' '\b(everything|all) that is wrong|\bwhat is wrong (with|in)\b'
tic what-became 'outcome, result' '\b(came|comes?|becomes?|became) (of|about)\b'

# Negative nouns, vague quantities.
tic none-for '`None` if; options: "default:"' '\bnone (for|where)\b'
Tic is-none 'is not a valid ...' '([^e]|[^r]e) (is|are) none\b' '(is|are) none of (the three|DISP|STRESS|this)'
tic no-number 'NaN; not a number' '\bno numbers?\b' 'no number of|carries no number'
tic so-many 'the number' '\bso many\b'
tic so-long 'longer than NAME' '\b(for|at most|by) so (long|much|often|far)\b|\bso (much|long|often) (after|before|at|inside)\b'
tic fractions 'percent or ratio' '\b(an?|one|two|three|four) (fifth|sixth|seventh|eighth|ninth|tenth|twelfth|twentieth|hundredth)s?\b|\bhalf (as|again)\b'
tic per 'one X per Y' '\bone( [A-Za-z-]+){1,2} a (state|case|node|row|tile|line|file|field|sample|regime|reading|format|topic|actuator|group|model|panel|client|device|job|sub-command|crate)\b|\b(nodes|rows|bytes|values|modes|digits|columns|line|row|basis|value|word) a (state|case|node|row|tile|line|field|sample|regime|reading|topic|actuator|model|cell|facet)\b' '\b[Oo]ne [A-Za-z-]+ (of|is|behind|in|for|as|with|from|on|at|per|to) a '

# Idiom.
tic of-its-own 'its own; separate; dedicated' "\b(of|by) (its|their|his|our|your|my|one'?s) own\b"
tic models-own 'named regime' "\b(is|are|was|be|not) the (model|user)s?'?s? own\b|\b(names?|regimes?) of (a|the) (model|user)s?'?s? own\b|\b(model|user)s?'?s? own (names?|regimes?)\b"
tic beside 'in addition to; compared with; while' '\bbeside (pressure|the (loop|twin|paper|samples|commercial|plain|best|values|numbers)|each other|other|others|running|a running|a twin|twins|it most|[0-9]|one with|that|those|ours|our|gauge|what)'
tic anew 'again; restart, reconnect, re-read' '\banew\b'
tic again-and-again 'repeatedly; every N ms' '\bagain and again\b'
tic for-ever 'indefinitely; without timeout' '\bfor ever\b|\bwithout end\b|\bas ever\b'
tic as-it-is 'unchanged' '\bas (it|they) (is|are)\b' 'as (it|they) (is|are) (now|needed|written|in use)'
tic goes-on 'continues' '\b(goes?|went|going) on\b' 'goes on the wire'
tic passes-over 'ignores, skips' '\bpass(es|ed) over\b' 'passes over (all|the (readings|modes|nodes|parameters))'
tic stands-in 'is in, is listed in' '\bstands? (in|on|below|above|there|here|beside|behind|at) '
tic says 'specifies, contains, reports' '\b(scene|file|line|state|reading|header|option|model|list|table|column|card|mesh|payload|configuration|number|database|name|description|filter|trace|manifest|specification)s? (itself )?(says?|said)\b'
tic persons 'no process, a reader, any writer, HTTP client' '\b(no|some|every)body\b|\bwhoever\b|\bvisitors?\b' 'MapAccess, Visitor|> Visitor<'
tic looks 'polls, checks; between polls' '\btwo looks\b|\blooks? (again|every|twice|[0-9]+ times|at that pace)\b|\bwithout a look\b|\blooked at\b'
tic turn 'iteration; control cycle' '\b(each|every|per|a|one|two|within a) turns?\b|turns of the loop|\bits turn\b'
tic half-made 'incomplete' '\bhalf-made\b|\bin the making\b'
tic trouble 'error; fix' '\btroubles?\b|\bmend(ing|ed)?\b'
tic at-hand 'available' '\bat hand\b'
tic refusal 'I/O error; operating-system error' "system's (refusal|text)\b"

# Words with a private or a double sense.
tic told 'identifiable; published; commanded; notified' '\b(un)?told\b' 'told apart|told otherwise'
tic tells 'identify; publish' '\b(readings?|recordings?|force|markers?|residuals?|modes|twins?|priors|holds?) tells?\b|\btells? (the|its|their|other) names'
tic border 'FFI boundary; regime classifier' '\bborder' 'border-|border:|border_(color|radius)'
Tic room 'scratch; capacity' '\bRoom\b|\broom: (&mut )?(Room|Evaluation)|&mut room\b|\broom\.(room|reserve|sums|near)|::with_room|room was given' 'Room for a (series|message)'
tic give 'set_parameters; write_handle' '\bfn give\b|[.:]give\('
tic bars 'half-width' '\berror bars?\b|\bbars: (bool|true|false)|^bars = |"bars"|wanted\.bars|gradients, bars|% bars|within the bars|\bthe bars promise|\bbar for (stress|force)' 'progress|BARS = '
tic own-error 'estimated model error' '\bown errors?\b'
tic share 'fraction' '\b(an?|the|which|what|stated|accepted|same|largest|smallest|least|this|that) shares?\b|\bas shares?\b|\bshares? of (a|the|an|its) (core|largest|range|error|states|sampled)'
tic by-input 'derivative with respect to' '(derivatives?|gradients?|slopes?)( of [a-z ]+)? by (the |each |every |all |its |scaled |an? )?(pressure|gap|inputs?|parameters?|state|model)'
tic less 'minus' '\bless (their|the|a|its|an) (half-widths?|bias|mean|model|rest)\b'
tic errs-by 'has an error of' '\berrs\b|\berred\b|\berr by\b'
tic to-the-bit 'bit-identical' '\bto the bit\b|\bsame bits\b|(keeps?|with) (their|its|the) bits\b'
tic held-out 'validation states; sealed test states' 'no training (ever )?(had |has )?(saw|seen|looked)|training (never|has never) (saw|sees|looks)|nobody (has|had) (seen|looked|used)|in sight while|looked at once|development states?|\buntouched (contact |free )?states?\b|kept aside|held[- ]back|fresh states?' '"a fresh state'
Tic promise 'nominal coverage; acceptance limit' '\bpromis(e|es|ed)\b' "(caller|importer)'s promise|promises are awaited"
tic domain 'training range; shared-memory domain' '\b(the|its|their|this|whole|sampled|trained|contact|free|every|a|of|same) (whole |sampled |trained |contact |free )?domains?\b' 'shared-memory domain|ROS_DOMAIN|domain_id'
tic switch 'contact onset, onset states' '\bboundary[ _]states?\b|\bonset boundary\b|\bthe switch\b'
tic os-kernel 'operating system (kernel: RBF or reconstruction)' '(asked of|asks?|of|by|in|from|through) the kernel\b|the kernel (closes|grants|releases|refuses|itself|has)'
tic page 'web viewer; metrics endpoint; this document' '\bthe page\b|metrics pages?\b'
tic story 'multi-process test; architecture.rs' '\bstor(y|ies)\b|mod house\b|house\.rs'
tic face 'public API, C API' '\b(public|small|C) faces?\b'
tic text 'string; message' '\btexts\b|\b(a|as) text\b'
tic whole-number 'integer' '\bwhole (numbers?|factors?|steps?)\b'

# History told as statement.
history=':!CHANGELOG.md'
tic as-it-was 'the present' '\bas (it|they) (was|were)\b|\bof before\b|(model|version|layout|release)s? before\b|[a-z] before\)|until then' 'mut before\)|\(begin, '
tic since 'now' '\bsince([.;,]|$)' 'since\.[a-z]'
tic hour 'date, machine, load' '(slow|fast|quiet) hour|(morning|evening) of (that|the same) day|\bof that (day|evening)\b|that evening'

if [ -z "$only" ]; then
    echo "tics: $sum (limit $LIMIT)"
    ((sum <= LIMIT)) || exit 1
fi
