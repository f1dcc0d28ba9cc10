/** Made by build.mjs from the program's tables: six hexadecimal digits per colour. */
declare module "isonest:color-maps" {
  const maps: Readonly<Record<string, string>>;
  export default maps;
}
