#!/usr/bin/env bash
# The steps of action.yml: `steps.sh build`, `steps.sh comment`. Other services may call them, too.
#
# RECIPES: patterns of recipes. BASE: the commit that a change starts from; empty = build them all.
# comment: NUMBER of the pull request, GITHUB_REPOSITORY, and GH_TOKEN for `gh`.
set -euo pipefail

body="${RUNNER_TEMP:-/tmp}/assetbuild-comment.md"
marker="<!-- assetbuild -->"

# Recipes that a change may concern: all of them once it touches anything but documentation outside
# of recipes, as a mesh or a part of a composite may be anywhere.
touched() {
  local changed recipe
  # shellcheck disable=SC2086 # patterns are expanded here
  set -- $RECIPES
  if [ -z "${BASE:-}" ]; then printf '%s\n' "$@"; return; fi
  changed="$(git diff --name-only "$BASE" HEAD -- . ':(exclude)*.md')"
  if printf '%s\n' "$changed" | grep -qvE '^$|(^|/)recipes/[^/]+\.ya?ml$'; then printf '%s\n' "$@"; return; fi
  for recipe in "$@"; do
    if printf '%s\n' "$changed" | grep -qxF -e "$recipe" -e "${recipe%.yaml}.lock.yaml"; then echo "$recipe"; fi
  done
}

build() {
  mapfile -t recipes < <(touched)
  if [ "${#recipes[@]}" = 0 ]; then echo "no recipe is touched"; return; fi
  assetbuild build "${recipes[@]}" --frozen -k
}

comment() {
  local recipe
  { echo "$marker"; echo "## What changes on the robots"; } > "$body"
  while read -r recipe; do
    printf '\n' >> "$body"
    if git cat-file -e "$BASE:$recipe" 2>/dev/null; then
      assetbuild diff --markdown "$BASE:$recipe" "$recipe" >> "$body" ||
        echo "\`$recipe\`: cannot be compared; see the job's summary" >> "$body"
    else
      echo "\`$recipe\` is new" >> "$body"
    fi
  done < <(touched)
  # GitHub takes 65,536 characters; the whole text is in the log.
  cat "$body"
  head -c 60000 "$body" > "$body.cut" && mv "$body.cut" "$body"
  local own
  own="$(gh api --paginate "repos/$GITHUB_REPOSITORY/issues/$NUMBER/comments" \
    --jq ".[] | select(.body | startswith(\"$marker\")) | .id" | head -n 1)"
  if [ -n "$own" ]; then
    gh api -X PATCH "repos/$GITHUB_REPOSITORY/issues/comments/$own" -F "body=@$body" > /dev/null
  else
    gh api "repos/$GITHUB_REPOSITORY/issues/$NUMBER/comments" -F "body=@$body" > /dev/null
  fi
}

case "${1:-}" in
  build | comment) "$1" ;;
  *) echo "usage: steps.sh build|comment" >&2; exit 2 ;;
esac
